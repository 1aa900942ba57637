"""The lag with which external torques are told."""

import numpy as np

# Time constant of the estimate [s]: that of contact forces which a motion at the arm's
# top speed builds up is 20 to 50 ms.
TIME_CONSTANT = 0.02


def lag_share(period: float, time_constant: float = TIME_CONSTANT) -> float:
    """Share of a step that a first-order lag follows in a period [s]."""
    return float(-np.expm1(-period / time_constant))
