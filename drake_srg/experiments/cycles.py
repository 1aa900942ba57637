"""Pick-and-place cycles of the five-axis arm, with the object's motion in the hand."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram

from drake_srg.common.log_format import MODES, pose_key
from drake_srg.experiments.whole_run import simulate_whole
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.measures import hand_poses
from drake_srg.simulation.metrics import Metrics
from drake_srg.station import MakeCell
from drake_srg.types import Mode, Vector


@dc.dataclass(frozen=True)
class Cycle:
    """The outcome of one run; None for phases that the run did not reach.

    Attributes:
        seed: Of the scenario.
        metrics: Of the run.
        p_GO_open: Centre of the object in the palm frame when the fingers begin to
            close, shape (3,) [m].
        p_GO_held: The same when the fingers hold the object.
        slip: Largest motion of the object in the hand, from when the fingers hold it
            until it is above its goal or lost [m].
        turn: Largest rotation of the object's axis in the hand during that time [rad].
        error_G: Placement error in the palm's axes, shape (3,) [m].
    """

    seed: int
    metrics: Metrics
    p_GO_open: Vector | None
    p_GO_held: Vector | None
    slip: float | None
    turn: float | None
    error_G: Vector | None


def run_cycle(
    scenario: str,
    seed: int,
    overrides: Sequence[str] = (),
    make_cell: Callable[[Scenario], Diagram] = MakeCell,
) -> Cycle:
    """Run a scenario once, without recordings.

    Args:
        scenario: Name of the scenario.
        seed: Of the scenario.
        overrides: `KEY=VALUE` each.
        make_cell: Makes the cell.
    """
    loaded = load_scenario(scenario, seed=seed, overrides=overrides)
    result = simulate_whole(loaded, name=scenario, make_cell=make_cell)
    return make_cycle(loaded, result.metrics, result.log)


def make_cycle(
    scenario: Scenario, metrics: Metrics, log: Mapping[str, Vector]
) -> Cycle:
    """Return the last cycle in a run's log: where the object was in the hand."""
    mode = [MODES[int(i)] for i in log["mode"]]
    begun = [k for k in range(len(mode)) if k == 0 or mode[k] is not mode[k - 1]]
    opened = [k for k in begun if mode[k] is Mode.CLOSE][-1:]
    held = [k for k, m in enumerate(mode) if m is Mode.VERIFY][-1:]
    carried = [
        k
        for k, m in enumerate(mode)
        if held and k > held[0] and m in (Mode.LIFT, Mode.TRANSFER)
    ]
    placed = [k for k, m in enumerate(mode) if m is Mode.PLACE][-1:]

    arm, poses = log["arm.state_measured"], log[pose_key(scenario.task.pick)]
    rows = sorted({*opened, *held, *carried, *placed})
    X_WG = dict(zip(rows, hand_poses(scenario, arm[rows]), strict=True))
    X_GO = {k: X_WG[k].inverse() @ _pose(poses[k]) for k in rows}
    p_GO = {k: X.translation() for k, X in X_GO.items()}
    slip = turn = error_G = None
    if carried:
        z_GO = {k: X.rotation().col(2) for k, X in X_GO.items()}
        slip = max(float(np.linalg.norm(p_GO[k] - p_GO[held[0]])) for k in carried)
        turn = max(_angle(z_GO[k], z_GO[held[0]]) for k in carried)
    if placed and metrics.placement_error_m is not None:
        R_GW = X_WG[placed[0]].rotation().inverse()
        error_G = R_GW @ np.array(metrics.placement_error_m)
    return Cycle(
        seed=scenario.random_seed,
        metrics=metrics,
        p_GO_open=p_GO[opened[0]] if opened else None,
        p_GO_held=p_GO[held[0]] if held else None,
        slip=slip,
        turn=turn,
        error_G=error_G,
    )


def _pose(row: Vector) -> RigidTransform:
    """Return X_WO from a row of `object_pose.NAME` in the log."""
    return RigidTransform(Quaternion(row[3:] / np.linalg.norm(row[3:])), row[:3])


def _angle(z_1: Vector, z_2: Vector) -> float:
    """Return the angle between two unit vectors [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(z_1, z_2)), z_1 @ z_2))
