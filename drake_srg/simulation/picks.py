"""What each grasp of a run took, by the ground truth in its log."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from drake_srg.common.log_keys import pose_key
from drake_srg.common.srg_geometry import SRG
from drake_srg.objects.household import ObjectFacts
from drake_srg.scenario import Scenario
from drake_srg.simulation import measures
from drake_srg.simulation.hand_poses import hand_poses
from drake_srg.simulation.log_format import MODES, row_to_pose
from drake_srg.types import Mode, Vector

# Where the fingers take things, in the palm [m].
_p_GC = np.array([SRG.grasp_center_x, 0.0, 0.0])
_LIFTED = 0.08  # least rise of the middle of what the hand carries over the bin [m]


def attempts_of(
    scenario: Scenario, log: Mapping[str, Vector], facts: Mapping[str, ObjectFacts]
) -> dict[str, int]:
    """Return how many grasps have closed nearest to each object."""
    mode, states = log["mode"], measures.arm_states(log)
    assert states is not None
    if not facts:  # the cameras may see a colour that no object is said to have
        return {}
    closes = mode == MODES.index(Mode.CLOSE)
    rows = np.flatnonzero(closes[1:] & ~closes[:-1]) + 1
    counts = dict.fromkeys(facts, 0)
    for row, X_WG in zip(rows, hand_poses(scenario, states[rows]), strict=True):
        distances = {
            name: box_distance(log[pose_key(name)][row], facts[name], X_WG @ _p_GC)
            for name in facts
        }
        counts[min(distances, key=lambda name: distances[name])] += 1
    return counts


def loads_carried(
    log: Mapping[str, Vector], facts: Mapping[str, ObjectFacts]
) -> list[list[str]]:
    """Return the names of what each grasp carried, at the end of its transfer.

    That is whatever is higher by then than it was as the fingers closed.

    Args:
        log: Arrays of log.npz: `mode`, and the poses of all objects.
        facts: Of the objects, by name.
    """
    closes, moves = (
        log["mode"] == MODES.index(mode) for mode in (Mode.CLOSE, Mode.TRANSFER)
    )
    begun = np.flatnonzero(closes[1:] & ~closes[:-1]) + 1

    def height(name: str, row: np.integer[Any]) -> float:
        middle = 0.5 * (facts[name].low + facts[name].high)
        return float((row_to_pose(log[pose_key(name)][row]) @ middle)[2])

    loads = []
    for end in np.flatnonzero(moves[:-1] & ~moves[1:]):
        before = begun[begun < end]
        if len(before):
            rose = {
                name: height(name, end) - height(name, before[-1]) for name in facts
            }
            loads.append([name for name in facts if rose[name] > _LIFTED])
    return loads


def delivered(loads: Sequence[Collection[str]], cleared: Collection[str]) -> int:
    """Return how many grasps have brought something where it rests in the end.

    What a later grasp has carried once more counts there only.

    Args:
        loads: Names of what each grasp carried, the first grasp first.
        cleared: Names of the objects that rest where they belong.
    """
    left = set(cleared)
    count = 0
    for load in reversed(loads):
        count += not left.isdisjoint(load)
        left.difference_update(load)
    return count


def box_distance(row: Vector, facts: ObjectFacts, p_W: Vector) -> float:
    """Return the distance of a point from the box around an object [m]."""
    p_O = row_to_pose(row).inverse() @ p_W
    outside = np.maximum(np.maximum(facts.low - p_O, p_O - facts.high), 0.0)
    return float(np.linalg.norm(outside))
