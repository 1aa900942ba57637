"""Logs of runs that never took place, and their metrics."""

import numpy as np
from numpy.polynomial import Polynomial
from pydrake.math import RigidTransform

from drake_srg.common.log_format import MODES, pose_to_row
from drake_srg.scenario import load_scenario
from drake_srg.simulation.metrics import RunTimes, calc_metrics
from drake_srg.types import Blob, Mode, PlannerStatus

SCENARIO = load_scenario("kitchen", seed=0)
HOME = np.array(SCENARIO.arm.home)
GOAL = np.array([0.55, -0.42, 0.05090])
START = np.array([0.6, 0.1, GOAL[2]])
DT = 0.02
# A run of 3 s: the time at which each mode begins [s].
BEGINS = {
    Mode.IDLE: 0.0,
    Mode.PRE_GRASP: 0.1,
    Mode.CLOSE: 0.5,
    Mode.LIFT: 1.0,
    Mode.TRANSFER: 1.5,
    Mode.RELEASE: 2.0,
    Mode.HOME: 2.2,
    Mode.DONE: 2.5,
}
ERROR = np.array([1e-4, -2e-4, 3e-4])
BLOB = Blob("soup_can", "ceiling", (1.0, 2.0), RigidTransform(START + ERROR), 1.0)


def make_log(**changes):
    """Return the log of a perfect run: the can jumps to its goal, the arm rests."""
    time = DT * np.arange(151)
    mode = np.zeros(151)
    for name, begin in BEGINS.items():
        mode[time >= begin - 1e-9] = MODES.index(name)
    carried = (time >= BEGINS[Mode.TRANSFER] - 1e-9)[:, None]
    position = np.where(carried, GOAL, START)
    log = {
        "time": time,
        "mode": mode,
        "object_pose.soup_can": np.hstack(
            [position, np.tile([1.0, 0, 0, 0], (151, 1))]
        ),
        "arm.state_measured": np.hstack([np.tile(HOME, (151, 1)), np.zeros((151, 7))]),
        "contact_force": np.zeros(151),
    }
    return log | changes


def judge(log, status=None, touching=("support",), scenario=SCENARIO):
    status = status or PlannerStatus(
        mode=Mode.DONE, attempts=1, localization=BLOB, localized_at=0.0
    )
    times = RunTimes(simulated=3.0, wall=1.5)
    return calc_metrics(scenario, "kitchen", log, status, set(touching), times, {})


def with_pose(log, rows, X):
    log["object_pose.soup_can"][rows] = pose_to_row(X)
    return log


# A speed profile over 0 .. 1 that starts and ends without jerk.
SMOOTH = 140 * Polynomial([0, 1]) ** 3 * Polynomial([1, -1]) ** 3


def moving(profile, amplitude=1.0):
    """Return a log in which joint 2 has a speed profile from first motion to last."""
    log = make_log()
    s = np.clip((log["time"] - 0.1) / 2.38, 0.0, 1.0)
    log["arm.state_measured"][:, 8] = amplitude * profile(s)
    return log
