"""The thresholds of `vision`, and what is tried in place of the values in use.

Half and twice, mostly; where a threshold is a number of rounds, a quantile or an angle,
a value on either side.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np

from drake_srg.vision import blob_localizer, candidates, obstacles, shape_fit, sight


@dc.dataclass(frozen=True, eq=False)
class Threshold:
    """A constant of a module and other values that are tried in its place."""

    module: ModuleType
    constant: str
    tried: tuple[Any, Any]

    def __str__(self) -> str:
        return f"{self.module.__name__.rpartition('.')[2]}.{self.constant}"

    @property
    def used(self) -> Any:
        """The value in use."""
        return getattr(self.module, self.constant)


@dc.dataclass(frozen=True)
class Setting:
    """One of the values tried of a threshold; without one, those in use."""

    threshold: Threshold | None = None
    which: int = 0

    def __str__(self) -> str:
        return f"{self.threshold} = {show(self.value)}" if self.threshold else "in use"

    @property
    def value(self) -> Any:
        """What the threshold is then."""
        return self.threshold.tried[self.which] if self.threshold else None

    def in_place(self) -> contextlib.AbstractContextManager[Any]:
        """Put the value in place of the module's own; on leaving, that is back."""
        if self.threshold is None:
            return contextlib.nullcontext()
        return patch.object(self.threshold.module, self.threshold.constant, self.value)


def show(value: Any) -> str:
    """Return a threshold's value as text."""
    return " ".join(f"{v:.3g}" for v in np.atleast_1d(value))


def _scaled(module: ModuleType, *constants: str) -> list[Threshold]:
    """Thresholds of which half and twice are tried."""

    def times(value: Any, factor: float) -> Any:
        if isinstance(value, int):
            return round(factor * value)
        if isinstance(value, tuple):
            return tuple(factor * v for v in value)
        return factor * value

    values = {name: getattr(module, name) for name in constants}
    return [
        Threshold(module, name, (times(value, 0.5), times(value, 2.0)))
        for name, value in values.items()
    ]


THRESHOLDS = (
    *_scaled(shape_fit, "_COARSE", "_MIDDLE"),
    Threshold(shape_fit, "_FINE", ((0.1,), (0.1, 0.03, 0.01))),
    *_scaled(shape_fit, "_EXPLAINED", "_UPRIGHT", "_MOST_UNEXPLAINED", "_ANOTHER"),
    *_scaled(shape_fit, "_DEVIATIONS", "_APART", "_LEAST_PIXELS"),
    Threshold(shape_fit, "_FEW", (1, 6)),
    Threshold(shape_fit, "_STANDS", tuple(np.cos(np.deg2rad([7.5, 45.0])))),
    *_scaled(shape_fit, "_BESIDE", "_WRONG", "_RING", "_MOST_DEVIATIONS", "_SLIDES"),
    *_scaled(shape_fit, "_MOST_THROUGH", "_FRAYED", "_ON_OUTLINE", "_LEAST_COLORED"),
    *_scaled(candidates, "_STEP", "_DEVIATIONS", "_SMALLEST", "_SET_OFF"),
    *_scaled(candidates, "_MOST_LEVEL", "_RIM", "_BESIDE"),
    *_scaled(blob_localizer, "_LESS_LIKE"),
    *_scaled(sight, "_COARSEST", "_DEVIATIONS", "_BEHIND"),
    *_scaled(obstacles, "_DEVIATIONS"),
    Threshold(obstacles, "_LEAST_PIXELS", (1, 16)),
    *_scaled(obstacles, "_NEAR"),
    Threshold(obstacles, "_TOP", (0.96, 1.0)),
    Threshold(obstacles, "_KNOWN", (0.0, 0.012)),
)
