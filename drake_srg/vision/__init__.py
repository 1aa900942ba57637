"""Localisation of objects in camera images."""
