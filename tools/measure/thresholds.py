"""The thresholds of vision, and the values that are tried in place of those in use.

Every value of `LocalizerThresholds` is a threshold, so a new one is tried as well. Half
and twice the value are tried, unless another pair makes more sense: where the value is
a number of stages, a quantile or an angle, or where half of it changes nothing.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from drake_srg.vision.config import LocalizerThresholds

_OTHER_PAIRS: dict[str, tuple[Any, Any]] = {
    "any_light.bright_quantile": (0.8, 0.95),
    "guesses.most_lean": (math.radians(7.5), math.radians(45.0)),
    "fit.fine_softness": ([0.1], [0.1, 0.03, 0.01]),
    "fit.noisy_guesses": (1, 6),
    "fit.most_standing_lean": (math.radians(7.5), math.radians(45.0)),
    "obstacles.least_pixels": (1, 16),
    "obstacles.top": (0.96, 1.0),
    "obstacles.known": (0.0, 0.012),
}


@dc.dataclass(frozen=True, eq=False)
class Threshold:
    """A value of `LocalizerThresholds` and a pair of others to try.

    Attributes:
        path: Dotted path of the value, such as "fit.apart".
        used: The value in use.
        tried: The other values.
    """

    path: str
    used: Any
    tried: tuple[Any, Any]

    def __str__(self) -> str:
        return self.path


@dc.dataclass(frozen=True)
class Setting:
    """One of the values to try for a threshold, or the values in use.

    Attributes:
        threshold: None for the values in use.
        which: Index of the value in `threshold.tried`.
    """

    threshold: Threshold | None = None
    which: int = 0

    def __str__(self) -> str:
        return f"{self.threshold} = {show(self.value)}" if self.threshold else "in use"

    @property
    def value(self) -> Any:
        """The value that is tried."""
        return self.threshold.tried[self.which] if self.threshold else None

    def config(self) -> LocalizerThresholds:
        """Return the thresholds in use but for the one that is tried."""
        config = LocalizerThresholds()
        if self.threshold is not None:
            *steps, name = self.threshold.path.split(".")
            setattr(functools.reduce(getattr, steps, config), name, self.value)
        return config


def show(value: Any) -> str:
    """Return a threshold's value as text."""
    return " ".join(f"{v:.3g}" for v in np.atleast_1d(value))


def _values(config: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted path and value of everything in nested dataclasses."""
    for field in dc.fields(config):
        value, own = getattr(config, field.name), path + field.name
        if dc.is_dataclass(value):
            yield from _values(value, f"{own}.")
        else:
            yield own, value


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, int):
        return round(factor * value)
    if isinstance(value, list):
        return [factor * v for v in value]
    return factor * value


def _make_thresholds() -> tuple[Threshold, ...]:
    values = dict(_values(LocalizerThresholds()))
    if unknown := _OTHER_PAIRS.keys() - values:
        raise ValueError(f"LocalizerThresholds lacks {', '.join(sorted(unknown))}")
    return tuple(
        Threshold(
            path,
            value,
            _OTHER_PAIRS.get(path, (_scaled(value, 0.5), _scaled(value, 2.0))),
        )
        for path, value in values.items()
    )


THRESHOLDS = _make_thresholds()
