"""Objects from files of others: meshes, URDF and SDF become models of convex pieces."""
