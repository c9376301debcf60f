"""Sections for the next tool: with the groove's direction and the surfaces' normals."""
