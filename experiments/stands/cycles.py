"""Pick-and-place cycles of the five-axis arm, with the object's motion in the hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import experiments.runner as ex
from drake_srg.common.log_format import MODES, pose_key, row_to_pose
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.measures import hand_poses
from drake_srg.types import Mode, Vector
from experiments.stands.cells import simulate_whole

# Where the arm thesis's table has its cylinder [m].
THESIS_PLACE = np.array([-0.32495, -0.17498, 0.125])


def run_cycle(name: str, seed: int, overrides: Sequence[str] = ()) -> ex.Measures:
    """Run a scenario once, without recordings.

    Of the run's metrics, return `placed`, `lifted`, `failure`, `cycle`, `placing` [s]
    and `smoothness`, `placement` and `localization` error (3) [m], `distance` from the
    goal in the plane [mm]; of the last cycle, in the hand: see `in_hand`. None for what
    the run did not reach.
    """
    scenario = load_scenario(name, seed=seed, overrides=overrides)
    result = simulate_whole(scenario, name=name)
    m = result.metrics
    error = m.placement_error_m
    return {
        "placed": bool(m.success),
        "lifted": bool(m.grasp_lifted),
        "failure": m.failure,
        "cycle": m.cycle_time_s,
        "placing": m.time_to_placement_s,
        "smoothness": m.smoothness,
        "placement": error,
        "localization": m.localization_error_m,
        "distance": 1e3 * np.linalg.norm(error[:2]) if error is not None else None,
        **in_hand(scenario, result.log, error),
    }


def in_hand(
    scenario: Scenario, log: Mapping[str, Vector], error: Sequence[float] | None
) -> ex.Measures:
    """Return where the object was in the hand in the last cycle of a run's log.

    That is `held_at`: its centre in the palm frame when the fingers hold it; `shift`:
    its motion while they close (3) [m]; `slip` and `turn`: largest motion [m] and
    rotation of its axis [rad] while it is carried; `error_G`: the placement error (3)
    [m] in the palm's axes, of an object that was released.
    """
    mode = [MODES[int(i)] for i in log["mode"]]
    begun = [k for k in range(len(mode)) if k == 0 or mode[k] is not mode[k - 1]]
    opened = [k for k in begun if mode[k] is Mode.CLOSE][-1:]
    held = [k for k, m in enumerate(mode) if m is Mode.VERIFY][-1:]
    up = [k for k, m in enumerate(mode) if m in (Mode.LIFT, Mode.TRANSFER)]
    carried = [k for k in up if held and k > held[0]]
    arm, poses = log["arm.state_measured"], log[pose_key(scenario.task.pick)]
    placed = [k for k, m in enumerate(mode) if m is Mode.PLACE][-1:]
    rows = sorted({*opened, *held, *carried, *placed})
    X_WG = dict(zip(rows, hand_poses(scenario, arm[rows]), strict=True))
    X_GO = {k: X_WG[k].inverse() @ row_to_pose(poses[k]) for k in rows}
    p_GO = {k: X.translation() for k, X in X_GO.items()}
    found: ex.Measures = dict.fromkeys(("shift", "held_at", "slip", "turn", "error_G"))
    if held:
        found["held_at"] = p_GO[held[0]]
    if opened and held:
        found["shift"] = p_GO[held[0]] - p_GO[opened[0]]
    if carried:
        z_GO = {k: X.rotation().col(2) for k, X in X_GO.items()}
        found["slip"] = max(np.linalg.norm(p_GO[k] - p_GO[held[0]]) for k in carried)
        z = z_GO[held[0]]
        found["turn"] = max(
            float(np.arctan2(np.linalg.norm(np.cross(z_GO[k], z)), z_GO[k] @ z))
            for k in carried
        )
    if placed and error is not None:
        R_GW = X_WG[placed[0]].rotation().inverse()
        found["error_G"] = R_GW @ np.array(error)
    return found


def shares(own: ex.Trials) -> ex.Values:
    """Return the shares of trials that lift the cylinder, and that place it."""
    common: dict[str, Any] = {"trials": len(own), "spread": 0.05, "first": ", share"}
    lifted = ex.share("grasped and lifted", sum(own["lifted"]), **common)
    return lifted | ex.share("placed", sum(own["placed"]), **common)


def placed_interval(own: ex.Trials) -> tuple[float, float]:
    return ex.wilson(sum(own["placed"]), len(own))
