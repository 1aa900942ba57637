"""An insertion over ROS 2: our planner in one process, a served cell in another.

The third case has a force limit below the push. There, the safety monitor must stop
the arm.
"""

import dataclasses as dc

import experiments.runner as ex
from experiments.hardware_loop import Way, run_served
from experiments.insertion import MOST_FORCE

_RATE = 0.15  # simulated seconds per real second, which two busy cores reach
_LATE = Way("insert", latency=0.02, lead=0.12)
_LIMIT = "{hand: {transient: 8.0, quasi_static: 4.0}}"  # [N]
_LIMITED = f"{{profile: {_LIMIT}, regions: [hand]}}"
# So the served arm publishes its external torques. It is far beyond any of them.
_FEELS = ("planner.max_external_torque=[300, 300, 300, 300, 300, 300, 300]",)
WAYS = {
    "no delay": Way("insert"),
    "20 ms late": _LATE,
    "20 ms late, force limit": dc.replace(_LATE, force=_LIMITED, settings=_FEELS),
}


def trial(seed: int, way: str) -> ex.Measures:
    return run_served(WAYS[way], seed, _RATE)


def summary(own: ex.Trials) -> ex.Values:
    stopped = sum("force" in told.split(", ") for told in own["told"])
    found: ex.Values = {
        "force on the hole [N]": (max(own["hole force"]), ex.at_most(MOST_FORCE))
    }
    if "limit" in own.name:
        return found | {"stopped by the limit []": (stopped, ex.at_least(len(own)))}
    return found | {"inserted []": (sum(own["placed"]), ex.at_least(len(own)))}


insertion_wire = ex.Experiment(
    "Insertions over ROS 2: with delay, and with a force limit.",
    lambda seeds=3: ex.grid(seed=range(seeds), way=WAYS),
    trial,
    by=("way",),
    summary=summary,
    serial=True,
)
