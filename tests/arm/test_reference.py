import numpy as np
import pytest
import ruckig
from helpers import fix, read, update
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.arm.driver import AddJerkLimits, ArmPositionDriver
from drake_srg.arm.reference import JerkLimitedReference, JerkLimits

V, A, J = np.deg2rad([110.0, 40.0, 80.0])  # the thesis's
PERIOD = 0.005
HOME = np.array([0.3, -1.0])

positions = st.floats(-3.0, 3.0)
targets = st.tuples(positions, positions).map(np.array)
# Targets, and for how many periods each stands.
changes = st.lists(st.tuples(targets, st.integers(1, 300)), min_size=1, max_size=6)


class Motion:
    """A reference on its own, with a record of its commands."""

    def __init__(self, home=HOME, limits=None, period=PERIOD):
        self.period = period
        self.system = JerkLimitedReference(home, limits or JerkLimits(), period)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.q = [self.position]

    @property
    def position(self):
        return read(self.system, self.context, "position_commanded")

    def go(self, target, periods):
        """Command a target; return all positions so far, shape (K, N)."""
        if target is not None:
            fix(self.system, self.context, position_desired=target)
        start = round(self.context.get_time() / self.period)
        for k in range(start + 1, start + periods + 1):
            self.simulator.AdvanceTo(k * self.period)
            self.q.append(self.position)
        return np.array(self.q)


def rest_to_rest_time(distance):
    """Return the least time from rest to rest (Biagiotti and Melchiorri, ch. 3.4)."""
    d = abs(distance)
    if d < 2 * A**3 / J**2:  # the acceleration limit is not reached
        return 4 * np.cbrt(d / (2 * J)) if d < 2 * V * np.sqrt(V / J) else np.inf
    if d < V * (V / A + A / J):  # the velocity limit is not reached
        return A / J + np.sqrt((A / J) ** 2 + 4 * d / A)
    return d / V + V / A + A / J


@settings(max_examples=30)
@given(changes)
def test_no_limit_is_exceeded_whenever_targets_change(changes):
    motion = Motion()
    for target, periods in changes:
        q = motion.go(target, periods)
    # Differences amplify the rounding of positions in double precision by 1/period³.
    rounding = 8 * np.finfo(float).eps * np.max(np.abs(q)) / PERIOD
    for limit in (V, A, J):
        q = np.diff(q, axis=0, prepend=q[:1]) / PERIOD
        assert np.max(np.abs(q)) <= limit * (1 + 1e-9) + rounding
        rounding *= 2 / PERIOD


@pytest.mark.slow
@settings(max_examples=30)
@given(changes)
def test_it_reaches_the_last_target_and_stays(changes):
    motion = Motion()
    for target, periods in changes:
        motion.go(target, periods)
    # Braking takes at most V / A + A / J. At most 9 radians are left then.
    longest = V / A + A / J + rest_to_rest_time(9.0)
    q = motion.go(None, int(longest / PERIOD) + 1)
    np.testing.assert_array_equal(q[-1], changes[-1][0])
    np.testing.assert_array_equal(motion.go(None, 3)[-3:], [changes[-1][0]] * 3)


@pytest.mark.slow
@settings(max_examples=30)
@given(positions)
def test_it_takes_the_least_time_from_rest_to_rest(target):
    motion = Motion(HOME[:1])
    time = rest_to_rest_time(target - HOME[0])
    after = int(np.ceil(time / PERIOD))
    q = motion.go(np.array([target]), after + 2)[:, 0]
    # Each period plans the rest of the motion anew. Where a limit is reached only just,
    # rounding can make it arrive up to two periods late.
    assert q[-1] == target
    assert q[after] == pytest.approx(target, abs=J * (2 * PERIOD) ** 3 / 6)
    if time > 8 * PERIOD:  # the last part slows down at the limit of the jerk
        early = time - (after - 2) * PERIOD
        assert abs(q[after - 2] - target) == pytest.approx(J * early**3 / 6, rel=1e-3)


def test_the_velocity_limit_is_reached_on_a_long_way():
    motion = Motion(np.zeros(1))
    time = rest_to_rest_time(20.0)
    assert time == 20.0 / V + V / A + A / J
    q = motion.go(np.array([20.0]), int(time / PERIOD) + 1)
    assert q[-2, 0] < q[-1, 0] == 20.0
    assert np.max(np.diff(q[:, 0])) / PERIOD == pytest.approx(V)


def test_joints_move_independently():
    both, one = Motion(), Motion(HOME[1:])
    short_and_long = np.array([0.31, 2.0])
    q = both.go(short_and_long, 1000)
    np.testing.assert_allclose(q[:, 1:], one.go(short_and_long[1:], 1000), atol=1e-12)
    assert 0 < np.argmax(q[:, 0] == 0.31) < np.argmax(q[:, 1] == 2.0)


def test_each_joint_can_have_its_own_limits():
    limits = JerkLimits(velocity=[1.0], acceleration=[10.0, 1.0], jerk=[1e4, 1e4])
    motion = Motion(np.zeros(2), limits)
    v = np.diff(motion.go(np.array([1.0, 1.0]), 100), axis=0) / PERIOD
    assert np.max(v, axis=0) == pytest.approx([1.0, 0.5], abs=0.01)  # at 0.5 s


def test_without_a_target_it_stays_at_home():
    motion = Motion()
    np.testing.assert_array_equal(motion.go(None, 10)[-1], HOME)
    np.testing.assert_array_equal(motion.go([np.nan, np.nan], 10)[-1], HOME)


@pytest.mark.parametrize("nothing", [np.nan, np.inf, -np.inf])
def test_an_entry_that_is_not_finite_leaves_the_last_target(nothing):
    motion = Motion()
    motion.go([1.0, 0.0], 20)
    motion.go([nothing, 1.0], 1000)
    np.testing.assert_array_equal(motion.position, [1.0, 1.0])


def test_an_update_gives_the_position_one_period_later():
    motion = Motion(np.zeros(1))
    q = motion.go(np.array([3.0]), 4)[:, 0]
    assert q == pytest.approx([J * (k * PERIOD) ** 3 / 6 for k in range(5)])


@pytest.mark.parametrize("period", [1 / 1024, 12 / 1024, 0.04])
def test_the_motion_does_not_depend_on_the_period(period):
    motion = Motion(period=period)
    reference = Motion(period=1 / 1024)
    k = int(3.0 / period)
    q = motion.go([2.0, -1.5], k)[-1]
    steps = k * period * 1024
    if steps == int(steps):
        np.testing.assert_allclose(
            q, reference.go([2.0, -1.5], int(steps))[-1], atol=1e-9
        )
    np.testing.assert_array_equal(motion.go(None, k)[-1], [2.0, -1.5])


def test_the_same_context_gives_the_same_motion():
    motion, other = Motion(), Motion()
    motion.go([1.0, 1.0], 50)
    other.context.SetTimeStateAndParametersFrom(motion.context)
    other.simulator.Initialize()
    np.testing.assert_array_equal(
        motion.go([0.0, 1.0], 50)[-1], other.go([0.0, 1.0], 50)[-1]
    )


def test_held_joints_rest_until_a_target_after_that_moves_them():
    motion = Motion()
    motion.go([1.0, 0.0], 100)
    held = np.array([0.5, -0.5])
    fix(motion.system, motion.context, position_held=held)
    np.testing.assert_array_equal(motion.go([0.9, 0.1], 10)[-1], held)
    fix(motion.system, motion.context, position_held=[np.nan, np.nan])
    np.testing.assert_array_equal(motion.go([np.nan, np.nan], 10)[-1], held)
    np.testing.assert_array_equal(motion.go([1.0, 1.0], 1000)[-1], [1.0, 1.0])


def test_the_reference_of_a_driver_starts_at_its_home():
    builder = DiagramBuilder()
    config = ArmPositionDriver(home=[0.1, 0.2, 0.3])
    reference = AddJerkLimits(builder, config)
    assert reference.get_name() == "arm_reference"
    context = reference.CreateDefaultContext()
    assert read(reference, context, "position_commanded").tolist() == config.home


def test_the_reference_starts_where_the_joints_are():
    system = JerkLimitedReference(HOME, JerkLimits(), PERIOD)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    where = HOME + 0.4
    fix(system, context, state_measured=[*where, 0.0, 0.0])
    simulator.AdvanceTo(0.1)
    np.testing.assert_array_equal(read(system, context, "position_commanded"), where)
    fix(system, context, position_desired=HOME)
    simulator.AdvanceTo(0.2)
    moved = read(system, context, "position_commanded") - where
    assert (moved < 0.0).all()
    assert (moved > -0.01).all()


def test_limits_that_do_not_fit_the_joints_are_refused():
    with pytest.raises(ValueError, match=r"limits.jerk: needs 1 entry or 2, got 3"):
        JerkLimitedReference(HOME, JerkLimits(jerk=[1.0] * 3), PERIOD)


def test_a_jerk_limited_reference_is_freed(leaked):
    Motion().go([1.0, 1.0], 2)
    assert leaked() == []


def test_an_update_without_a_motion_is_an_error(monkeypatch):
    class Helpless:
        def __init__(self, n):
            pass

        def calculate(self, move, trajectory):
            return ruckig.Result.ErrorExecutionTimeCalculation

    system = JerkLimitedReference(np.zeros(1), JerkLimits(), 0.005)
    context = system.CreateDefaultContext()
    fix(system, context, position_desired=1.0)
    monkeypatch.setattr(ruckig, "Ruckig", Helpless)
    with pytest.raises(RuntimeError, match="Ruckig finds no motion"):
        update(system, context)
