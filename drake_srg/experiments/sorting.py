"""Objects sorted by colour and by name into two bins, and set upright in a row.

Every scene is drawn from its seed: where the objects lie or stand, and how they are
turned; in `varied`, also their sizes and friction, the light, the camera's errors and
the strength of the motors. The seeds are not those that the planner was tuned on.
"""

from __future__ import annotations

from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.table_trials import Scenes, run_tables

# By name, each bin gets things of both colours.
_NAMES = (
    "task.place.bins.red_bin=[red_block, blue_can, red_ball]",
    "task.place.bins.blue_bin=[blue_block, red_can, blue_ball]",
)
SCENES: Scenes = {
    "colour, two bins": ("sort_table", ()),
    "name, two bins": ("sort_table", _NAMES),
    "name, row": ("row_table", ()),
    "colour, varied": ("sort_table_varied", ()),
    "colour, linkage gripper": ("sort_table_linkage", ()),
}


def run(
    track: Track, *, trials: int = 5, seed: int = 10300, keep: str = ""
) -> ExperimentResult:
    """Sort the table in every scene.

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
        place="where they belong",
        title="Tables sorted",
    )
