"""A table cleared on the accurate physics, by wires, and with everything varied.

The first two scenes differ in the gripper's driver, and in how long the planner waits
for it. The third has the fast physics. The seeds are not those of `clearing`, nor those
that the planner was tuned on.
"""

from __future__ import annotations

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.table_trials import Scenes, run_tables

SCENES: Scenes = {
    "accurate": ("clear_table", ()),
    "accurate, wires": ("clear_table_tendon", ()),
    "varied": ("clear_table_varied", ()),
}


def run(
    track: Track, *, trials: int = 8, seed: int = 10100, keep: str = ""
) -> ExperimentResult:
    """Clear the table in every scene.

    Args:
        track: Shows progress.
        trials: Of each scene.
        seed: Of the first trial.
        keep: File of finished trials, with which a run that was cut off goes on.
    """
    return run_tables(
        track,
        SCENES,
        trials,
        seed,
        keep,
        place="in the bin",
        title="Tables cleared under other conditions",
    )
