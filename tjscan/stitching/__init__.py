"""Several scans of one joint made one groove, in the joint's own frame."""
