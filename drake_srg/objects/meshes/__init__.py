"""Import of objects: meshes, URDF and SDF files become models of convex pieces."""
