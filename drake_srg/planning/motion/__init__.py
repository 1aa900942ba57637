"""Motion planning: collisions, inverse kinematics, paths, trajectories."""
