"""Import of arms from URDF and SDF files: models, limits, homes, scenarios, checks."""
