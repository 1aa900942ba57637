"""Grasps of a hand, and the search for grasps that the arm can reach."""
