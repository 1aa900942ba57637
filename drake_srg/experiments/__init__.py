"""Experiments: what the models and drivers do, measured; one file each."""
