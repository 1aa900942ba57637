"""The rows of a sweep as arrays, with nan for missing values."""

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
        table: A pyarrow.Table from `read_rows`.
        sampled: Names of its columns that contain drawn values.
    """

    def __init__(self, table: Any, sampled: list[str]):
        self._table = table
        self._sampled = sampled
        self.trial: list[int] = self.column("trial")
        self.seed: list[int] = self.column("seed")
        self.success: npt.NDArray[np.bool_] = np.array(
            self.column("success"), dtype=bool
        )
        # Failed trials that the planner reported as done.
        self.claimed: npt.NDArray[np.bool_] = ~self.success & np.array(
            [bool(claimed) for claimed in self.column("claimed")], dtype=bool
        )
        self.failure: list[str] = [f or "unknown" for f in self.column("failure")]
        self.message: list[str] = [m or "" for m in self.column("message")]
        self.cycle_time = self.numbers("cycle_time_s")
        self.time_to_placement = self.numbers("time_to_placement_s")
        self.grasp_lifted = self.numbers("grasp_lifted")
        self.placement_error = self.norms("placement_error_m")
        self.localization_error = self.norms("localization_error_m")
        self.localization_turn = self.numbers("localization_turn_rad")
        self.others_moved = self.numbers("others_moved_m")
        self.attempts = self.numbers("attempts")

    def __len__(self) -> int:
        return len(self.trial)

    def column(self, name: str) -> list[Any]:
        """Return the values of a column; None for every missing one."""
        if name not in self._table.column_names:
            return [None] * self._table.num_rows
        return list(self._table.column(name).to_pylist())

    def numbers(self, name: str) -> Vector:
        """Return a column of numbers, shape (len(self),)."""
        return _numbers(self.column(name))

    def norms(self, name: str) -> Vector:
        """Return the lengths of a column's vectors, shape (len(self),)."""
        return np.array(
            [
                np.nan if vector is None else np.linalg.norm(_numbers(vector))
                for vector in self.column(name)
            ]
        )

    def quantities(self) -> dict[str, Vector]:
        """Return the drawn quantities that vary, by name; shape (len(self),).

        A quantity whose values are words becomes one quantity per word: 1 where it was
        drawn. With clutter, its smallest distance from another object is a quantity,
        too. Quantities that fewer than `FEW` trials have are left out.
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
        """Return the smallest distance between clutter and any other object [m].

        Distances are between centres on the table. All pieces of clutter are drawn
        alike, so a single one says little.

        Returns:
            Shape (len(self),), nan where a trial has no clutter.
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
        """Return the indices of all rows, the worst first.

        The order is: wrongly reported done, other failures, successes; and each group
        by falling placement error.
        """
        error = np.nan_to_num(self.placement_error, nan=np.inf)
        order = np.lexsort((np.arange(len(self)), -error, self.success, ~self.claimed))
        return [int(row) for row in order]


def command(*words: str, overrides: Sequence[str]) -> str:
    """Return a `drake-srg` command line."""
    sets = [word for override in overrides for word in ("--set", override)]
    return shlex.join(["drake-srg", *words, *sets])


def _numbers(values: list[Any]) -> Vector:
    return np.array([np.nan if v is None else float(v) for v in values], dtype=float)
