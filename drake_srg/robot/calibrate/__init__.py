"""Calibration of cameras: intrinsics and pose from images of a ChArUco board."""
