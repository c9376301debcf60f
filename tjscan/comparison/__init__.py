"""How far what was scanned lies from what was designed."""
