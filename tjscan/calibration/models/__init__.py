"""What a sensor on a flange sees of each kind of target, and how it errs."""
