"""Sweeps of many trials of a scenario, their reports, and data sets made from them."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
