"""Simulation of a cell, its log and recordings, and the judgement of the result."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
