"""Grippers: finger sensors, control, drives, and the drivers made of them."""
