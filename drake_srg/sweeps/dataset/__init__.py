"""LeRobot data sets, made from the recordings of sweeps."""
