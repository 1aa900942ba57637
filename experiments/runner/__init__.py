"""Runs, judges, draws and compares experiments: what a file of claims imports."""

from experiments.runner.claims import (
    Bound,
    Case,
    Measures,
    Row,
    Trials,
    Values,
    at_least,
    at_most,
    counts,
    number,
    quantiles,
    share,
    wilson,
    within,
)
from experiments.runner.experiment import Experiment, chosen, grid
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
    "Row",
    "Trials",
    "Values",
    "at_least",
    "at_most",
    "chosen",
    "counts",
    "grid",
    "number",
    "quantiles",
    "share",
    "wilson",
    "within",
]
