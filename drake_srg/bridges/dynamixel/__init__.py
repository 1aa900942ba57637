"""The gripper's Dynamixel servo, for the real gripper's driver."""
