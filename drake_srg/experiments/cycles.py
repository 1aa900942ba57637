"""Cycles of the five-axis arm's cell, for the experiments about it."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram

from drake_srg.cell import MakeCell
from drake_srg.hand_poses import hand_poses
from drake_srg.metrics import MODES, Metrics
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation import Simulate
from drake_srg.types import Mode, Vector


@dc.dataclass(frozen=True)
class Cycle:
    """What came of one run."""

    seed: int
    metrics: Metrics
    # The object's centre in the palm when the fingers begin to close, and when they
    # hold it, (3,) [m]; None where it did not come to that.
    p_GO_open: Vector | None
    p_GO_held: Vector | None
    error_G: Vector | None  # placement error in the palm's axes, (3,) [m]


def run_cycle(
    scenario: str,
    seed: int,
    overrides: Sequence[str] = (),
    make_cell: Callable[[Scenario], Diagram] = MakeCell,
) -> Cycle:
    """Run a scenario of a cell once, without recordings."""
    loaded = load_scenario(scenario, seed=seed, overrides=overrides)
    result = Simulate(loaded, name=scenario, make_cell=make_cell)
    log, mode = result.log, result.log["mode"].astype(int)
    poses = log[f"object_pose.{loaded.task.pick}"]

    begins = np.flatnonzero(np.diff(mode, prepend=-1))

    def last(wanted: Mode, rows: npt.NDArray[np.intp]) -> int | None:
        rows = rows[mode[rows] == MODES.index(wanted)]
        return int(rows[-1]) if len(rows) else None

    every = np.arange(len(mode))
    rows = {
        "open": last(Mode.CLOSE, begins),
        "held": last(Mode.VERIFY, every),
        "placed": last(Mode.PLACE, every),
    }
    X_WG: dict[str, RigidTransform] = {}
    p_GO: dict[str, Vector] = {}
    for name, row in rows.items():
        if row is not None:
            (X_WG[name],) = hand_poses(loaded, log["arm.state_measured"][row][None])
            p_GO[name] = X_WG[name].inverse() @ poses[row, :3]
    error = result.metrics.placement_error_m
    return Cycle(
        seed=seed,
        metrics=result.metrics,
        p_GO_open=p_GO.get("open"),
        p_GO_held=p_GO.get("held"),
        error_G=X_WG["placed"].rotation().inverse() @ np.array(error)
        if "placed" in X_WG and error is not None
        else None,
    )
