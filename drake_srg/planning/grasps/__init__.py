"""Grasps of a hand, and the search for one that the arm reaches."""
