import numpy as np
import pytest
from helpers import fix, read
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.gripper.linkage_driver import (
    MasterSlaveConfig,
    MasterSlaveReference,
)

CONFIG = MasterSlaveConfig()
V, T = CONFIG.max_velocity, CONFIG.period


class Fingers:
    """Fingers that follow their references perfectly, up to where they are stuck."""

    def __init__(self, closure=1.0, **optional):
        self.system = MasterSlaveReference()
        self.context = self.system.CreateDefaultContext()
        self.stuck = np.full(2, np.inf)  # the largest angles that they reach
        self.give(closure_commanded=closure, grasped=0.0, **optional)

    def give(self, **inputs):
        fix(self.system, self.context, **inputs)

    @property
    def reference(self):
        return read(self.system, self.context, "reference")

    @property
    def q(self):
        return np.minimum(self.reference[:2], self.stuck)

    def advance(self, duration):
        """Let time pass; return references and angles after each update."""
        references, angles = [], []
        for _ in range(round(duration / T)):
            self.give(state_measured=[*self.q, 0.0, 0.0])
            event = self.system.EvalUniquePeriodicDiscreteUpdate(self.context)
            self.context.SetDiscreteState(event)
            self.context.SetTime(self.context.get_time() + T)
            references.append(self.reference)
            angles.append(self.q)
        return np.array(references), np.array(angles)


def test_the_master_moves_at_full_speed_and_stops_at_its_target():
    fingers = Fingers(closure=0.5)
    references, _ = fingers.advance(1.0)
    goal = 0.5 * CONFIG.full_scale
    times = T * np.arange(1, len(references) + 1)
    assert references[:, 0] == pytest.approx(np.minimum(V * times, goal))
    assert fingers.reference == pytest.approx([goal, goal, 0, 0, 0, 0], abs=1e-3)


def test_the_slave_is_three_degrees_behind():
    _, angles = Fingers().advance(0.5)
    # The speed over the gain: 60 degrees/s over 20/s.
    assert angles[-1, 0] - angles[-1, 1] == pytest.approx(np.radians(3.0), rel=1e-2)


def test_the_slave_follows_what_is_measured():
    fingers = Fingers()
    fingers.stuck[0] = 0.2
    references, _ = fingers.advance(1.5)
    assert references[-1, 0] == pytest.approx(CONFIG.full_scale)
    assert references[-1, 1] == pytest.approx(0.2, abs=1e-6)


def test_the_reference_is_continuous_between_updates():
    fingers = Fingers()
    fingers.advance(0.2)
    fingers.give(state_measured=[*fingers.q, 0.0, 0.0])
    event = fingers.system.EvalUniquePeriodicDiscreteUpdate(fingers.context)
    fingers.context.SetDiscreteState(event)
    time, before = fingers.context.get_time(), fingers.reference
    fingers.context.SetTime(time + 0.3 * T)
    moved = before[:2] + 0.3 * T * before[2:4]
    assert fingers.reference[:2] == pytest.approx(moved)
    assert np.all(before[2:4] > 0.5)


def test_both_stand_still_once_something_is_gripped():
    fingers = Fingers()
    fingers.advance(0.3)
    fingers.give(grasped=1.0)
    before = fingers.reference[:2]
    references, _ = fingers.advance(0.5)
    assert np.all(references == [*before, 0, 0, 0, 0])


@pytest.mark.parametrize("closure", (0.8, 1.0))
def test_they_stay_when_the_object_is_lost_or_the_command_still_closes(closure):
    fingers = Fingers()
    fingers.advance(0.3)
    fingers.give(grasped=1.0)
    fingers.advance(0.1)
    before = fingers.reference
    fingers.give(grasped=0.0, closure_commanded=closure)
    fingers.advance(0.1)
    assert np.all(fingers.reference == before)


def test_opening_lets_go_for_good():
    fingers = Fingers()
    fingers.advance(0.4)
    fingers.give(grasped=1.0)
    fingers.advance(0.1)
    # The sensors still fire for a while.
    fingers.give(closure_commanded=0.0)
    references, _ = fingers.advance(0.1)
    assert np.all(np.diff(references[:, 0]) == pytest.approx(-V * T))
    fingers.give(grasped=0.0)
    fingers.advance(1.0)
    assert fingers.reference == pytest.approx(np.zeros(6), abs=1e-6)


def test_both_release_their_grip_at_the_same_speed():
    fingers = Fingers()
    fingers.stuck[:] = 0.25, 0.2
    fingers.advance(0.4)
    fingers.give(grasped=1.0)
    fingers.advance(0.1)
    held = fingers.reference[:2]
    assert np.all(held > fingers.stuck + 0.01)
    fingers.give(closure_commanded=0.0)
    references, angles = fingers.advance(0.6)
    pressing = np.all(references[:, :2] > fingers.stuck, axis=1)
    steps = np.diff(np.vstack([held, references[pressing, :2]]), axis=0)
    assert len(steps) > 5
    assert steps == pytest.approx(np.full(steps.shape, -V * T))
    # The slave, which lags, does not close while the master opens.
    assert np.all(np.diff(angles, axis=0) <= 1e-12)


def test_hold_keeps_a_grip_though_the_command_opens():
    fingers = Fingers()
    fingers.stuck[:] = 0.25, 0.2
    fingers.advance(0.4)
    fingers.give(grasped=1.0)
    fingers.advance(0.1)
    before = fingers.reference
    fingers.give(closure_commanded=0.0, hold=1.0)
    fingers.advance(0.1)
    assert np.all(fingers.reference == before)
    fingers.give(hold=0.0, grasped=0.0)
    fingers.advance(1.0)
    assert fingers.reference[:2] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_grip_begins_when_the_fingers_stand_at_their_target():
    """Once it grips, the slave stops pressing harder."""
    fingers = Fingers(closure=0.3)
    fingers.stuck[1] = 0.1
    fingers.advance(0.5)
    fingers.give(grasped=1.0)
    before = fingers.reference[1]
    fingers.advance(0.2)
    assert fingers.reference[1] == before


def test_finite_joint_positions_override_closure():
    fingers = Fingers(joint_position_commanded=[np.nan, 0.3])
    fingers.give(closure_commanded=0.0)
    references, _ = fingers.advance(0.5)
    assert np.all(references[:, 0] == 0.0)
    assert references[10, 1] == pytest.approx(11 * T * V)
    assert references[-1, 1] == pytest.approx(0.3)


def test_hold_stops_both():
    fingers = Fingers()
    fingers.advance(0.2)
    fingers.give(hold=1.0, joint_position_commanded=[0.0, 0.0])
    before = fingers.reference[:2]
    references, _ = fingers.advance(0.2)
    assert np.all(references == [*before, 0, 0, 0, 0])
    fingers.give(hold=0.0, joint_position_commanded=[np.nan, np.nan])
    assert np.all(fingers.advance(0.1)[0][-1, :2] > before)


def test_a_nan_keeps_the_last_closure():
    fingers = Fingers(closure=0.5)
    fingers.advance(0.1)
    fingers.give(closure_commanded=np.nan)
    fingers.advance(1.0)
    assert fingers.reference[0] == pytest.approx(0.5 * CONFIG.full_scale)


commands = st.tuples(
    st.floats(-1, 2), st.booleans(), st.floats(-1, 2), st.floats(0, 0.7)
)


@given(st.lists(commands, min_size=1, max_size=12))
def test_speeds_and_angles_stay_within_their_limits(sequence):
    fingers = Fingers()
    for closure, grasped, wanted, stuck in sequence:
        fingers.stuck[1] = stuck
        fingers.give(
            closure_commanded=closure,
            grasped=float(grasped),
            joint_position_commanded=[np.nan, wanted],
        )
        references, _ = fingers.advance(0.05)
        assert np.all(np.abs(references[:, 2:4]) <= V * (1 + 1e-12))
        assert np.all(references[:, :2] >= -1e-12)
        assert np.all(references[:, :2] <= CONFIG.full_scale + 1e-12)
