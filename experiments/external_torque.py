"""External torques of carrying arms and the limits of their protective stops.

Each cell runs on the fast and on the accurate physics. The fast physics derives the
torques from contacts, the accurate one estimates them from motors and motion. In normal
operation, the torques must stay below half of a joint's limit.
"""

import numpy as np

import experiments.runner as ex
from drake_srg import Mode, ScenarioError, load_scenario
from drake_srg.common.log_format import MODES
from experiments.stands.cells import simulate_whole

CELLS = ("kitchen_varied", "assistive_arm_varied")
# With this seed, the cylinder grazes the rim of its recess on the fast physics.
MORE_SEEDS = {"assistive_arm_varied": (800264,)}
# In these modes the hand carries an object, and the planner watches the torques.
_CARRYING = [MODES.index(mode) for mode in (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)]


def cases(seeds: int = 10) -> list[ex.Case]:
    return [
        {"scenario": name, "seed": seed}
        for cell in CELLS
        for name in (cell, f"{cell}_accurate")
        for seed in (*range(seeds), *MORE_SEEDS.get(cell, ()))
    ]


def trial(scenario: str, seed: int) -> ex.Measures:
    """Return the largest torque of each joint during the carry, shape (N,) [N m]."""
    loaded = load_scenario(scenario, seed=seed)
    log = simulate_whole(loaded, name=f"{scenario}, seed {seed}").log
    carrying = np.isin(log["mode"], _CARRYING)
    if not np.any(carrying):
        raise ScenarioError(
            f"external_torque: {scenario}, seed {seed}: the arm carries nothing"
        )
    torque = np.max(np.abs(log["arm.external_torque"][carrying]), axis=0)
    return {"joint": np.arange(len(torque)) + 1, "external torque [N m]": torque}


def summary(own: ex.Trials) -> ex.Values:
    cell = own.name.removesuffix("_accurate")
    stop = load_scenario(cell, seed=0).planner.max_external_torque
    assert stop is not None
    largest = np.max(own["external torque [N m]"], axis=0)
    return {
        f"joint {i + 1} [N m]": (torque, ex.at_most(0.5 * limit))
        for i, (torque, limit) in enumerate(zip(largest, stop, strict=True))
    }


external_torque = ex.Experiment(
    "External torques of carrying arms and the limits of their protective stops.",
    cases,
    trial,
    summary=summary,
    picture=[ex.Points("joint", "external torque [N m]")],
)
