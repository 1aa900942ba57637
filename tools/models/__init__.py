"""What `tools/build_models.py` builds from; one file a robot, one for the props."""
