"""Policies that grasp: networks, learners, training and evaluation."""
