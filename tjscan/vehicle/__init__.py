"""What a vehicle is, what it truly does on the steel, and its drivers."""
