"""Grippers: finger sensors, control, drives, and drivers that combine them."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
