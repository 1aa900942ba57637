"""Runs, judges, draws and compares experiments: what a file of claims imports."""

from experiments.runner.claims import (
    Bound,
    Case,
    Measures,
    Trials,
    Values,
    at_least,
    at_most,
    number,
    quantiles,
    share,
    wilson,
    within,
)
from experiments.runner.experiment import Experiment, grid
from experiments.runner.pictures import Bars, Curves, Histogram, Images, Points

__all__ = [
    "Bars",
    "Bound",
    "Case",
    "Curves",
    "Experiment",
    "Histogram",
    "Images",
    "Measures",
    "Points",
    "Trials",
    "Values",
    "at_least",
    "at_most",
    "grid",
    "number",
    "quantiles",
    "share",
    "wilson",
    "within",
]
