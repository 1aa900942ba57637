"""What is no hole for the peg is told by name, with no more force than allowed.

The peg of `insert` meets a plate without a hole, a hole that is 0.05 mm too narrow, and
a hole with a plug in it. Each is a try of its own, without a repetition.
"""

import experiments.runner as ex
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate

HOLES = {
    "no_hole": "directives.hole.add_model.file=package://drake_srg/sdf/hole_none.sdf",
    "too_tight": "objects.peg.shape.radius=0.01255",
    "hole_blocked": (
        "objects.plug={shape: !Cylinder {radius: 0.01, length: 0.01}, mass: 0.05,"
        " friction: 0.3, known: false, color: [0.2, 0.2, 0.2],"
        " pose: {translation: [0.55, -0.3, 0.0151]}}"
    ),
}
MOST_FORCE = 30.0  # between peg and hole [N]


def cases() -> list[ex.Case]:
    """Try each."""
    return ex.grid(failure=HOLES)


def trial(failure: str) -> ex.Measures:
    changes = [HOLES[failure], "planner.tries=1"]
    metrics = Simulate(load_scenario("insert", overrides=changes)).metrics
    return {
        "told by name [-]": float(metrics.failure == failure),
        "force on the hole [N]": metrics.hole_force_n,
    }


insertion_told = ex.Experiment(
    "What is no hole for the peg is told by name, with no more force than allowed.",
    cases,
    trial,
    {
        "told by name": ex.at_least(1.0),
        "force on the hole": ex.at_most(MOST_FORCE),
    },
    by=("failure",),
)
