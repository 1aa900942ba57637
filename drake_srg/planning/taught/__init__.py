"""Taught waypoints: the motions of the five-axis arm's thesis."""
