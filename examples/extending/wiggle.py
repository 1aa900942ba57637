"""A mode of your own in picking and placing: the hand wiggles before the lift."""

import enum

import numpy as np
from pydrake.trajectories import PiecewisePolynomial

from drake_srg import Simulate, load_scenario
from drake_srg.planning import (
    FATAL,
    TRANSITIONS,
    Carrying,
    Transitions,
    task_modes,
)
from drake_srg.station import MakePlanner
from drake_srg.types import Mode


class Own(enum.Enum):
    """Modes besides the planner's."""

    WIGGLE = "wiggle"


class Wiggle(Carrying):
    """Turns the last joint to and fro, and notices if the hand loses the object."""

    mode = Own.WIGGLE

    def trajectory(self, memory):
        """Return the motion of the arm's joints."""
        q = memory.motion.destination
        turned = q.copy()
        turned[-1] += 0.1
        return PiecewisePolynomial.CubicShapePreserving(
            [0.0, 0.3, 0.6], np.vstack((q, turned, q)).T, True
        )


# A row for the new mode, and a way into it. o is observed, t the time in the mode [s].
OWN_TRANSITIONS = {
    **TRANSITIONS,
    Mode.VERIFY: [
        (lambda o, t, c: not o.holding, Mode.RELEASE),
        (lambda o, t, c: t >= c.verify_time, Own.WIGGLE),
    ],
    Own.WIGGLE: [
        (lambda o, t, c: o.arrived and not o.holding, Mode.RELEASE),
        (lambda o, t, c: o.arrived, Mode.LIFT),
    ],
}


def own_modes(config, replanner, repeat):
    """Return the actions of every mode."""
    wiggle = Wiggle(config, replanner, repeat)
    return {**task_modes(config, replanner, repeat), Own.WIGGLE: wiggle}


def make_planner(scenario):
    """Return the planner of a scenario, with the mode."""
    transition = Transitions(OWN_TRANSITIONS, FATAL)
    return MakePlanner(scenario, make_modes=own_modes, transition=transition)


if __name__ == "__main__":
    result = Simulate(load_scenario("kitchen_fast"), make_planner=make_planner)
    print(result.metrics.table())
