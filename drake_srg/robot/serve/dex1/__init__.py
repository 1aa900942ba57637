"""The topics of SAKE's driver for the hands of a Unitree humanoid."""
