"""An ABB arm over Externally Guided Motion (EGM)."""
