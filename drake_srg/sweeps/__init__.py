"""Runs many trials of a scenario, reports on them and makes data sets of them."""

from drake_srg.face import face

__getattr__, __dir__, __all__ = face(__name__)
