"""Robots whose joints and grippers are Dynamixel servos on a bus."""
