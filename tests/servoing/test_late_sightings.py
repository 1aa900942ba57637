"""Where the arm was when a picture was taken that arrives late."""

import numpy as np
import pytest
from helpers import fix, port_table, read
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from drake_srg.servoing.late_sightings import LateSightings
from drake_srg.servoing.sightings import PoseSighting

PERIOD, AHEAD = 0.0078125, 3.0  # the arm's clock is ahead of ours [s]


class Arm:
    """An arm that turns at 1 rad/s, and what its camera showed."""

    def __init__(self):
        self.system = LateSightings(1, PERIOD)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()

    def run(self, seconds, sighting):
        """Advance; return the newest sighting that can be used."""
        for _ in range(round(seconds / PERIOD)):
            time = self.context.get_time()
            fix(
                self.system,
                self.context,
                arm_state=[time, 1.0],
                arm_stamp=time + AHEAD,
                sighting=AbstractValue.Make(sighting),
            )
            self.simulator.AdvanceTo(time + PERIOD)
        return read(self.system, self.context, "sighting")


def test_a_late_picture_is_dated_and_placed():
    arm = Arm()
    assert arm.run(0.5, PoseSighting()).taken.time == -np.inf
    seen = arm.run(0.1, PoseSighting(7, stamp=0.4 + AHEAD))
    assert seen.frame == 7
    assert seen.taken.time == pytest.approx(0.4)
    np.testing.assert_allclose(seen.taken.q, [0.4], atol=1e-9)


def test_a_picture_from_ahead_of_the_measurements_waits_for_them():
    arm = Arm()
    arm.run(0.25, PoseSighting())
    picture = PoseSighting(7, stamp=0.3 + AHEAD)
    assert arm.run(0.02, picture).taken.time == -np.inf
    assert arm.run(0.06, picture).taken.time == pytest.approx(0.3)


def test_a_picture_from_before_the_history_is_not_used():
    arm = Arm()
    arm.run(1.5, PoseSighting())
    assert arm.run(0.1, PoseSighting(7, stamp=0.3 + AHEAD)).frame == 0
    assert arm.run(0.1, PoseSighting(8, stamp=1.0)).frame == 0  # of another clock


def test_sightings_are_forgotten_once_there_are_none():
    arm = Arm()
    assert arm.run(0.5, PoseSighting(7, stamp=0.1 + AHEAD)).frame == 7
    assert arm.run(PERIOD, PoseSighting()).taken.time == -np.inf


def test_ports():
    assert port_table(LateSightings(7, PERIOD)) == (
        {"sighting": None, "arm_state": 14, "arm_stamp": 1},
        {"sighting": None},
    )
