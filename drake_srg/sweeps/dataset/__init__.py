"""LeRobot data sets of the recordings of sweeps."""
