"""Identifies a gripper's motor, friction and heat from its servo's own registers."""
