"""The rows of a sweep as a report needs them: arrays, with nan where nothing is."""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.sweeps.report.effects import FEW
from drake_srg.types import Vector

_NEAREST = "clutter: nearest to another object"


class Trials:
    """The columns of a sweep's rows.

    Args:
        table: A pyarrow.Table of rows, as `read_rows` returns it.
        sampled: The names of its columns that hold sampled values.
    """

    def __init__(self, table: Any, sampled: list[str]):
        self._table = table
        self._sampled = sampled
        self.trial: list[int] = self.column("trial")
        self.seed: list[int] = self.column("seed")
        self.success: npt.NDArray[np.bool_] = np.array(
            self.column("success"), dtype=bool
        )
        # The planner said done, and was wrong.
        self.claimed: npt.NDArray[np.bool_] = ~self.success & np.array(
            [bool(claimed) for claimed in self.column("claimed")], dtype=bool
        )
        self.failure: list[str] = [f or "unknown" for f in self.column("failure")]
        self.message: list[str] = [m or "" for m in self.column("message")]
        self.cycle_time = self.numbers("cycle_time_s")
        self.placement_error = self.norms("placement_error_m")
        self.localization_error = self.norms("localization_error_m")
        self.others_moved = self.numbers("others_moved_m")
        self.attempts = self.numbers("attempts")

    def __len__(self) -> int:
        return len(self.trial)

    def column(self, name: str) -> list[Any]:
        """The values of a column; None where it has none, or is not there."""
        if name not in self._table.column_names:
            return [None] * self._table.num_rows
        return list(self._table.column(name).to_pylist())

    def numbers(self, name: str) -> Vector:
        """A column of numbers, shape (len(self),)."""
        return _numbers(self.column(name))

    def norms(self, name: str) -> Vector:
        """The lengths of a column's vectors, shape (len(self),)."""
        return np.array(
            [
                np.nan if vector is None else np.linalg.norm(_numbers(vector))
                for vector in self.column(name)
            ]
        )

    def quantities(self) -> dict[str, Vector]:
        """What was sampled and differs between trials, by name; shape (len(self),).

        What has words for values becomes one quantity a word: 1 where it was drawn.
        Where there is clutter, how near it is to another object is one, too. What
        fewer than `FEW` trials have tells nothing and is left out.
        """
        quantities: dict[str, Vector] = {_NEAREST: self._nearest_clutter()}
        for name in self._sampled:
            values = self.column(name)
            words = sorted({value for value in values if isinstance(value, str)})
            if words:
                quantities |= {
                    f"{name} = {word}": _numbers(
                        [None if value is None else value == word for value in values]
                    )
                    for word in words
                }
            else:
                quantities[name] = _numbers(values)
        return {
            name: values
            for name, values in quantities.items()
            if np.count_nonzero(np.isfinite(values)) >= FEW
            and len(np.unique(values[np.isfinite(values)])) > 1
        }

    def _nearest_clutter(self) -> Vector:
        """The smallest distance of clutter from another object, on the table [m].

        Between centres; shape (len(self),), nan where a trial has no clutter.
        Things of the clutter are drawn alike, so that none of them alone says much.
        """
        places: dict[str, list[Vector]] = {}
        for name in self._sampled:
            match = re.fullmatch(r"objects\.(.+)\.position\[[01]\]", name)
            if match:
                places.setdefault(match[1], []).append(self.numbers(name))
        points = {name: np.array(p) for name, p in places.items() if len(p) == 2}
        clutter = [p for name, p in points.items() if name.startswith("clutter_")]
        others = [p for name, p in points.items() if not name.startswith("clutter_")]
        nearest = np.full(len(self), np.nan)
        for p, q in itertools.product(clutter, others):
            nearest = np.fmin(nearest, np.linalg.norm(p - q, axis=0))
        return nearest

    def worst(self) -> list[int]:
        """All rows, the worst first.

        Those that the planner said done and was wrong about, other failures, then the
        rest; each from the largest placement error on.
        """
        error = np.nan_to_num(self.placement_error, nan=np.inf)
        order = np.lexsort((np.arange(len(self)), -error, self.success, ~self.claimed))
        return [int(row) for row in order]


def command(*words: str, overrides: Sequence[str]) -> str:
    """Return a command line of ours."""
    sets = [word for override in overrides for word in ("--set", override)]
    return shlex.join(["drake-srg", *words, *sets])


def _numbers(values: list[Any]) -> Vector:
    return np.array([np.nan if v is None else float(v) for v in values], dtype=float)
