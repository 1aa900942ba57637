"""Arm drivers."""
