"""Experiments compare the models and drivers with published claims and theory."""
