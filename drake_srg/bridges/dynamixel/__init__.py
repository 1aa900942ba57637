"""The gripper's servo: an emulated Dynamixel MX-64."""
