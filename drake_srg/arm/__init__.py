"""Arms: drivers, jerk-limited references, external torques, kinematics."""
