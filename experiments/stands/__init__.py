"""Shared parts of experiments: whole cells, benches, objects to grasp."""
