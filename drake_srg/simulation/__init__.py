"""Simulation: runs a cell, logs and records the run, and judges the result."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
