"""Clearing a table of everything on it, from height maps alone."""
