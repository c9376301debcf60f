"""The arm's kinematic deviations and the sensor's pose on its flange, found together."""
