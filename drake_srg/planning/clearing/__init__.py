"""Clearing a table of whatever is on it, from height maps alone."""
