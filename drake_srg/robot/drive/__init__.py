"""Robots in place of the simulation: drivers, the station, and runs on hardware."""
