"""Statistics that outliers do not spoil."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def robust_deviation(residuals: npt.NDArray[Any]) -> float:
    """Return the standard deviation of residuals about 0, from their median.

    Args:
        residuals: Normally distributed but for outliers, which are fewer than half.
    """
    return 1.4826 * float(np.median(np.abs(residuals)))
