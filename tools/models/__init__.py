"""Sources of `tools/build_models.py`: one file per robot, and one for the props."""
