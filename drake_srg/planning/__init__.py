"""Planning: motions, grasps, the pick-and-place task, and scripts in its place."""
