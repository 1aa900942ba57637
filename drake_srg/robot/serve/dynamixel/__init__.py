"""The station's Dynamixel servos, for the drivers of real ones."""
