import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from drake_srg.robot.twin.comparison import ObjectComparison, Sighting

PERIOD = 0.01


class Stand:
    """Two objects: the first moves along x at 0.5 m/s, the second rests at 0."""

    def __init__(self, placed_at=None):
        self.system = ObjectComparison(["mover", "rester"], PERIOD)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.fix("placed_at", placed_at or {"mover": 0.0, "rester": 0.0})
        self.fix("sightings", ())
        self.steps = 0

    def fix(self, name, value):
        port = self.system.GetInputPort(name)
        port.FixValue(self.context, AbstractValue.Make(value))

    def advance(self, seconds):
        for _ in range(round(seconds / PERIOD)):
            poses = {
                "mover": RigidTransform([0.5 * self.steps * PERIOD, 0.0, 0.0]),
                "rester": RigidTransform(),
            }
            self.fix("object_poses", poses)
            self.steps += 1
            self.simulator.AdvanceTo(self.steps * PERIOD)
        return self.system.get_output_port().Eval(self.context)

    def see(self, name, time, p_WO):
        self.fix("sightings", (Sighting(name, time, RigidTransform(p_WO)),))


def test_nothing_is_compared_before_it_is_seen():
    assert np.isnan(Stand().advance(0.5)).all()


@pytest.mark.parametrize("age", [0.0, 0.123, 1.0])
def test_a_late_picture_is_compared_with_the_time_it_was_taken(age):
    stand = Stand()
    stand.advance(1.5)
    time = 1.5 - age
    stand.see("mover", time, [0.5 * time, 0.03, 0.0])
    error = stand.advance(0.02)
    assert error[0] == pytest.approx(0.03, abs=1e-9)
    assert np.isnan(error[1])


def test_a_picture_of_the_future_waits():
    stand = Stand()
    stand.advance(1.0)
    stand.see("rester", 1.5, [0.0, 0.0, 0.2])
    assert np.isnan(stand.advance(0.4)).all()
    assert stand.advance(0.2)[1] == pytest.approx(0.2)


def test_pictures_from_before_an_object_was_placed_do_not_count():
    stand = Stand({"rester": 1.0})
    stand.advance(2.0)
    stand.see("rester", 0.9, [0.0, 0.0, 0.2])
    assert np.isnan(stand.advance(0.1)).all()
    stand.see("rester", 1.1, [0.0, 0.0, 0.1])
    assert stand.advance(0.1)[1] == pytest.approx(0.1)


def test_objects_that_were_never_placed_and_unknown_ones_do_not_count():
    stand = Stand({"rester": 0.0})
    stand.advance(1.0)
    stand.see("mover", 0.5, [9.0, 0.0, 0.0])
    stand.advance(0.1)
    stand.see("ghost", 0.5, [9.0, 0.0, 0.0])
    assert np.isnan(stand.advance(0.1)).all()
