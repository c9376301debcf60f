"""How far what was scanned is from what was designed."""
