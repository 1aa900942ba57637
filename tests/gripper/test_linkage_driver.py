import numpy as np
import pytest
from helpers import fix, read
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.gripper.linkage_driver import MasterSlaveConfig, MasterSlaveReference
from gripper.driven_hand import PALM_TO_TIP, LinkageHand

MODELS = ("linkage_gripper", "linkage_gripper_flat")
CRANK, RADIUS = 0.045, 0.0125
# Pointing straight ahead, a crank holds the cylinder; the open pads are 60 mm apart.
STRAIGHT = np.arcsin((0.030 - RADIUS) / CRANK)
LAG = np.radians(60.0) / 20.0  # of the slave behind the master at full speed
STALL_TORQUE = 0.52
G = 9.81


@pytest.fixture(scope="module", params=MODELS)
def holding(request):
    """A hand that has closed on the cylinder, and then the table goes down."""
    hand = LinkageHand(model=request.param, radius=RADIUS)
    hand.command(closure_commanded=1.0)
    hand.advance(1.0)
    hand.closed = len(hand.log["time"])
    hand.lower_table(0.02)
    hand.advance(0.5)
    return hand


def test_cranks_are_measured_in_the_order_of_their_names():
    hand = LinkageHand()
    for i, name in enumerate(hand.config.joint_names):
        joint = hand.plant.GetJointByName(name)
        joint.set_angle(hand.plant_context, 0.1 * (i + 1))
        joint.set_angular_rate(hand.plant_context, 1.0 * (i + 1))
    assert hand.read("state_measured") == pytest.approx([0.1, 0.2, 1.0, 2.0])


@pytest.mark.slow
def test_it_holds_the_cylinder_when_the_table_goes(holding):
    before, after = holding.log["object"][holding.closed - 1], holding.p_GO()
    # The compliance of the pads: 20 g shear 2.5 mm of 2 MPa rubber by micrometres.
    assert before[2] - after[2] < 1e-4
    assert holding.read("grasped") == [1.0]
    wrenches = holding.read("contact_wrench").reshape(2, 6)
    down = [
        -up_of(holding, finger) @ wrench[3:]
        for finger, wrench in zip(("master", "slave"), wrenches, strict=True)
    ]
    assert sum(down) == pytest.approx(0.02 * G, rel=0.05)


def up_of(hand, finger):
    """Return the vertical in the frame of a fingertip."""
    tip = hand.plant.GetBodyByName(f"{finger}_tip")
    return tip.EvalPoseInWorld(hand.plant_context).rotation().matrix()[2]


def test_the_stiffness_of_the_servos_makes_the_grip(holding):
    """References beyond the contact give a torque; over the crank, a force."""
    force, pwm = holding.read("contact_force"), holding.read("pwm")
    lever = CRANK * np.cos(STRAIGHT - holding.q)
    assert force == pytest.approx(pwm * STALL_TORQUE / lever, rel=0.02)
    # Enough for 200 g at a friction of 0.4.
    assert np.min(force) > 0.2 * G / 2 / 0.4
    # At most half of the stall torque, because a hobby servo gets hot.
    assert np.max(pwm) < 0.5


def test_the_hold_shifts_the_object_towards_the_slave(holding):
    """Its reference stands still three degrees behind the master's."""
    shift = holding.p_GO() - [PALM_TO_TIP, 0.0, 0.0]
    assert shift[1] == pytest.approx(-CRANK * LAG / 2, rel=0.15)
    assert abs(shift[0]) < 2e-4


def test_loops_stay_closed(holding):
    """Within the clearance of a pin of 4 mm in its hole (ISO 286: H7/g6, 24 µm)."""
    assert np.max(holding.array("loop")) < 24e-6


def test_the_speed_is_that_of_the_thesis(holding):
    v = holding.array("state_measured")[:, 2:]
    # Half a second passes from open to the cylinder. The servo overshoots at the start.
    midway = (holding.array("time") > 0.2) & (holding.array("time") < 0.35)
    assert v[midway] == pytest.approx(np.radians(60.0), rel=0.02)
    assert np.max(v) < 1.1 * np.radians(60.0)


def test_a_grasp_counts_after_the_post_contact_delay(holding):
    time, grasped = holding.array("time"), holding.array("grasped")[:, 0]
    fired = np.all(holding.array("proximity") < 0.001, axis=1)
    first = time[np.flatnonzero(fired)[0]]
    # Sensors and detector are sampled every 10 ms.
    assert time[np.flatnonzero(grasped)[0]] - first == pytest.approx(0.1, abs=0.021)
    assert not grasped[time < first].any()


@pytest.mark.slow
def test_opening_does_not_push_the_object():
    hand = LinkageHand(radius=RADIUS)
    hand.command(closure_commanded=1.0)
    hand.advance(0.9)
    assert hand.read("grasped") == [1.0]
    held = hand.p_GO()
    hand.command(closure_commanded=0.0)
    hand.advance(0.9)
    assert hand.q == pytest.approx([0.0, 0.0], abs=0.005)
    assert hand.read("grasped") == [0.0]
    assert hand.read("contact_force") == pytest.approx([0.0, 0.0])
    # Within a tenth of the shift by closing.
    assert hand.p_GO() == pytest.approx(held, abs=CRANK * LAG / 2 / 10)


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "friction"), [(0.2, 0.4), (0.02, 0.2)])
def test_it_holds_a_heavy_and_a_slippery_object(mass, friction):
    hand = LinkageHand(radius=RADIUS, mass=mass, friction=friction)
    hand.command(closure_commanded=1.0)
    hand.advance(0.9)
    hand.lower_table(0.02)
    hand.advance(0.5)
    assert hand.p_GO()[2] > -1e-3


@pytest.mark.slow
def test_it_loses_an_object_without_friction():
    hand = LinkageHand(radius=RADIUS, friction=0.0)
    hand.command(closure_commanded=1.0)
    hand.advance(0.9)
    hand.lower_table(0.02)
    hand.advance(0.3)
    assert hand.p_GO()[2] < -0.015


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_an_empty_hand_closes_further(model):
    hand = LinkageHand(model=model)
    hand.command(closure_commanded=1.0)
    hand.advance(1.3)
    # The fingers sense each other and report a grasp; their angles tell it apart. The
    # rims of curved pads, 40 degrees from the middle of the arc, meet before flat pads.
    rims = RADIUS * (1.0 - np.cos(np.radians(40.0))) if model == MODELS[0] else 0.0
    empty = STRAIGHT + np.arcsin((RADIUS - rims) / CRANK)
    assert np.mean(hand.q) == pytest.approx(empty, abs=0.02)
    assert hand.read("grasped") == [1.0]
    assert np.mean(hand.q) > STRAIGHT + 0.15


@pytest.mark.slow
def test_the_fingertips_move_apart_without_turning():
    hand = LinkageHand()
    hand.command(closure_commanded=0.3)
    hand.advance(0.8)
    for finger in ("master", "slave"):
        X_GT = hand.plant.GetBodyByName(f"{finger}_tip").EvalPoseInWorld(
            hand.plant_context
        )
        x = X_GT.rotation().matrix()[:, 0]
        assert x == pytest.approx([1.0, 0.0, 0.0], abs=1e-4)


@pytest.mark.slow
def test_each_crank_can_be_commanded():
    hand = LinkageHand()
    hand.command(joint_position_commanded=[0.3, 0.1])
    hand.advance(0.8)
    assert hand.q == pytest.approx([0.3, 0.1], abs=0.005)


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
