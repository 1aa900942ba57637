"""Grasps of a hand, and the search for one that can be reached."""
