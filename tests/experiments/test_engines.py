"""Comparisons of Drake and MuJoCo, by procedures that are written once for both."""

import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.planning.grasps.sampled_grasps import SampledGrasp
from experiments import engine_shakes
from experiments.data import household_objects
from experiments.free_closing import deviations, vendors
from experiments.payload import CLOSE, HOLD, LIFT, judge_hold, largest
from experiments.runner import Trials
from experiments.stands.floating_grasps import LOST, Shake, draw, judge
from experiments.stands.grasps import grasps, present
from experiments.stands.mujoco_grasps import MujocoBench

GRASP = SampledGrasp(
    X_OG=RigidTransform(),
    half_gap=0.05,
    width=0.05,
    score=1,
    shifted=False,
    wrapped=False,
)
SHAKE = Shake(GRASP, [0.0, 90.0, 0.0], 0.3, 0.5, 100.0, np.array([0.0, 9.0, 0.0]))


class Fake:
    """An engine whose object falls at a speed once it has its weight."""

    def __init__(self, speed=0.0, depths=(0.001,), touches=False):
        self.floats, self.closed, self.fallen, self.time = False, False, 0.0, 0.0
        self.speed, self.found, self.touches = speed, list(depths), touches

    def levitate(self, floats):
        self.floats = floats

    def close(self, limit):
        self.closed = limit

    def advance(self, duration, arm):
        assert np.isfinite(arm(0.0)).all()
        self.time += duration
        if not self.floats:
            self.fallen += duration * self.speed

    def p_GO(self):
        return np.array([0.15 + self.fallen, 0.0, 0.0])

    def finger_speed(self):
        return 0.0

    def depths(self):
        return self.found if self.closed or self.touches else []


def test_a_still_object_is_held():
    found = judge(Fake(), SHAKE, 0.3)
    assert found["held"]
    assert (found["moved"], found["creep"], found["depth"]) == (0.0, 0.0, 1.0)


def test_an_object_that_falls_is_lost_at_once():
    engine = Fake(speed=1.0)
    assert not judge(engine, SHAKE, 0.3)["held"]
    assert LOST < engine.fallen < 4.0 * LOST


def test_a_hand_that_touches_at_the_start_is_not_closed():
    engine = Fake(touches=True)
    assert judge(engine, SHAKE, 0.3)["touched"]
    assert not engine.closed


def test_fingers_that_find_nothing_lose_it():
    engine = Fake(depths=())
    assert not judge(engine, SHAKE, 0.3)["held"]
    assert engine.time == pytest.approx(4.0)


def test_a_shake_is_drawn_alike_again():
    first = draw("mug", 3)
    draw("bowl", 3)
    again = draw("mug", 3)
    assert first.grasp.X_OG.IsExactlyEqualTo(again.grasp.X_OG)
    assert (first.mass, first.friction) == (again.mass, again.friction)
    assert draw("mug", 4).mass != first.mass


def test_verdicts_are_compared_where_no_open_hand_touches():
    ours, theirs = "Drake, SAP", engine_shakes.REFERENCE
    held = {theirs: [True, True, False, True], ours: [True, False, True, True]}
    trials = Trials(
        [
            {"engine": engine, "held": held[engine][i], "touched": i == 3}
            for engine in (theirs, ours)
            for i in range(4)
        ]
    )
    found = engine_shakes.agreement(trials)[ours]
    assert found["grasps tested []"] == 3
    assert found["same verdict []"][0] == pytest.approx(1 / 3)
    assert found["holds what the reference loses []"] == 1
    assert found["loses what the reference holds []"] == 1


def test_drakes_friction_in_mujoco():
    thing = household_objects()["003_cracker_box"]  # 0.6
    scenario = present(thing, grasps()["003_cracker_box", "above"])
    bench = MujocoBench(scenario, {"harmonic": True})
    model = bench.model
    own = np.array(model.geom_bodyid) == bench.thing.id
    own &= np.array(model.geom_contype) > 0
    pad = model.geom("gripper_left_tip_link_left_pad").id
    assert max(model.geom_friction[pad, 0], model.geom_friction[own, 0].max()) == (
        pytest.approx(2 * 0.6 * 0.8 / 1.4)
    )


def test_the_vendors_own_table_does_not_deviate():
    force, angles = vendors()
    found = deviations("tip", force, angles["tip"])
    assert found["angle at equal force [%]"][0] == 0.0
    off = deviations("tip", force, angles["tip"] + np.deg2rad(1.0))
    assert off["angle at equal force [degrees]"][0] == pytest.approx(1.0)


TIME = np.linspace(0.0, CLOSE + LIFT + HOLD, 1651)


@pytest.mark.parametrize(("slip", "held"), [(0.0, HOLD), (0.006, 0.0)])
def test_a_pinch_counts_from_when_the_load_comes_on(slip, held):
    p_GO = np.zeros((len(TIME), 3))
    p_GO[TIME > CLOSE + 0.5, 2] = slip
    found = judge_hold("pinch", TIME, p_GO, np.zeros((len(TIME), 4)))
    assert found["held_for"] == pytest.approx(held)
    assert found["slip"] == pytest.approx(1e3 * slip)


def test_the_largest_mass_is_bracketed():
    found = largest(lambda m: {"held_for": HOLD if m < 3.3 else 0.0}, 5.0)
    assert 3.3 / 1.02 < found["largest"] < 3.3
