import numpy as np
import pytest

from drake_srg.gripper import LinkageDriver
from gripper.linkage_hand import PALM_TO_TIP, Hand

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
    hand = Hand(model=request.param, radius=RADIUS)
    hand.command(closure_commanded=1.0)
    hand.advance(1.0)
    hand.closed = len(hand.log["time"])
    hand.lower_table(0.02)
    hand.advance(0.5)
    return hand


def test_cranks_are_measured_in_the_order_of_their_names():
    hand = Hand()
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
    hand = Hand(radius=RADIUS)
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
    hand = Hand(radius=RADIUS, mass=mass, friction=friction)
    hand.command(closure_commanded=1.0)
    hand.advance(0.9)
    hand.lower_table(0.02)
    hand.advance(0.5)
    assert hand.p_GO()[2] > -1e-3


@pytest.mark.slow
def test_it_loses_an_object_without_friction():
    hand = Hand(radius=RADIUS, friction=0.0)
    hand.command(closure_commanded=1.0)
    hand.advance(0.9)
    hand.lower_table(0.02)
    hand.advance(0.3)
    assert hand.p_GO()[2] < -0.015


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_an_empty_hand_closes_further(model):
    hand = Hand(model=model)
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
    hand = Hand()
    hand.command(closure_commanded=0.3)
    hand.advance(0.8)
    for finger in ("master", "slave"):
        X_GT = hand.plant.GetBodyByName(f"{finger}_tip").EvalPoseInWorld(
            hand.plant_context
        )
        x = X_GT.rotation().matrix()[:, 0]
        assert x == pytest.approx([1.0, 0.0, 0.0], abs=1e-4)


@pytest.mark.slow
def test_hold_stops_the_fingers():
    hand = Hand()
    hand.command(closure_commanded=1.0)
    hand.advance(0.3)
    hand.command(hold=1.0)
    hand.advance(0.5)
    held = hand.q
    assert np.all((held > 0.1) & (held < 0.4))
    hand.advance(0.3)
    assert hand.q == pytest.approx(held, abs=1e-3)


@pytest.mark.slow
def test_the_force_limit_bounds_the_grip():
    hand = Hand(radius=RADIUS)
    hand.command(closure_commanded=1.0, force_limit=0.2)
    hand.advance(1.0)
    pwm = np.abs(hand.array("pwm"))
    assert np.max(pwm) == pytest.approx(0.2)
    assert np.max(hand.read("contact_force")) < 1.05 * 0.2 * STALL_TORQUE / CRANK
    assert hand.read("grasped") == [1.0]


@pytest.mark.slow
def test_each_crank_can_be_commanded():
    hand = Hand()
    hand.command(joint_position_commanded=[0.3, 0.1])
    hand.advance(0.8)
    assert hand.q == pytest.approx([0.3, 0.1], abs=0.005)


@pytest.mark.slow
def test_touch_can_trigger_instead():
    hand = Hand(radius=RADIUS, config=LinkageDriver(trigger="touch"))
    hand.command(closure_commanded=1.0)
    hand.advance(1.0)
    assert hand.read("grasped") == [1.0]
