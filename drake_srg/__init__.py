"""The underactuated SAKE Robotics gripper and its robot cells as Drake diagrams."""
