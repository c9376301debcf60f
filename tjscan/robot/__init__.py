"""What an arm is, its kinematics, and its drivers."""
