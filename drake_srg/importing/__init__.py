"""Arms from URDF and SDF files of others: models, limits, homes, scenarios, checks."""
