"""Inverse kinematics, trajectories and the pick-and-place state machine."""
