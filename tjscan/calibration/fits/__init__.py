"""What a profile shows of a calibration target: a line, an arc or a roof, and how exactly."""
