"""Grippers: finger sensors, control, drives, and the drivers made of them."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
