"""A KUKA arm over RobotSensorInterface (RSI)."""
