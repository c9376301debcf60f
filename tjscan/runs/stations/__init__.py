"""Scans from several stations, and how they are stitched."""
