"""A KUKA controller on this machine, which speaks RobotSensorInterface (RSI)."""
