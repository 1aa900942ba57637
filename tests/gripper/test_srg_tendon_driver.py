import numpy as np
import pytest
from helpers import port_table
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper.drivers import (
    AddSrgTendonDriver,
    SrgPositionDriver,
    SrgTendonDriver,
)
from gripper.srg_hand import Hand

TENDON = SrgTendonDriver()


@pytest.fixture(scope="module")
def tendon_wrapped():
    hand = Hand(post=True, config=TENDON)
    hand.command(closure_commanded=1.0)
    hand.advance(3.5)
    return hand


def test_the_tendon_driver_has_a_motors_ports():
    ports = port_table(Hand(config=TENDON).driver)
    assert ports[0]["force_limit"] == 1
    assert "joint_position_commanded" not in ports[0]
    assert [ports[1][n] for n in ("pwm", "motor_state", "wire_force")] == [1, 2, 2]


def test_wires_close_the_bases_first(tendon_wrapped):
    q, proximity = (np.array(tendon_wrapped.log[n]) for n in ("q", "proximity"))
    for base, tip in ((0, 2), (1, 3)):
        touched = np.flatnonzero(proximity[:, base] < 0.0)[0]
        # Held by its spring, the tip does not leave its stop before.
        assert np.max(q[:touched, tip]) < 0.01
        assert q[-1, tip] > 0.5


def test_the_plant_takes_all_that_the_wires_give():
    # The model's effort limits are those of motors at the joints: not of wires, whose
    # moment arm at the base doubles as the finger closes.
    hand = Hand(post=True, config=TENDON)
    hand.command(closure_commanded=1.0, force_limit=1.0)
    hand.advance(2.0)
    net = hand.plant.get_net_actuation_output_port(hand.model)
    applied = net.Eval(hand.plant.GetMyContextFromRoot(hand.root))
    # Sampled a step apart; the force still rises.
    assert applied == pytest.approx(hand.read("actuation"), rel=0.01)
    assert np.max(applied) > 2.1


def test_wires_pull_with_the_force_limit(tendon_wrapped):
    expected = TENDON.servo.force_limit * TENDON.drive.full_wire_force
    force = tendon_wrapped.read("wire_force")
    # Two seconds after the fingers close, seven times the wires' and motor's 0.3 s.
    assert force == pytest.approx([expected] * 2, rel=0.01)


def test_wires_let_go(tendon_wrapped):
    tendon_wrapped.command(closure_commanded=0.0)
    tendon_wrapped.advance(4.0)
    assert tendon_wrapped.q == pytest.approx([0.0] * 4, abs=0.02)
    assert tendon_wrapped.read("wire_force") == pytest.approx([0.0, 0.0], abs=0.1)


def test_wires_close_an_empty_hand_as_position_control_does():
    # Level: x along the palm is horizontal, and gravity along the hinges.
    for config in (TENDON, SrgPositionDriver()):
        hand = Hand(config=config)
        hand.command(closure_commanded=0.4)
        hand.advance(1.5)
        assert hand.q == pytest.approx([1.2, 1.2, 0.0, 0.0], abs=0.02)


def test_a_spool_on_hold_stays():
    hand = Hand(config=TENDON)
    hand.command(closure_commanded=0.5)
    hand.advance(0.4)
    hand.command(hold=1.0)
    hand.advance(0.3)
    held = hand.read("motor_state")[0]
    hand.advance(0.3)
    assert hand.read("motor_state")[0] == pytest.approx(held, abs=1e-3)
    assert 0.1 < held < 2.5


def test_a_motor_at_each_joint_and_one_at_the_wires_is_one_too_many():
    hand = Hand()
    with pytest.raises(ValueError, match="SetTendonDynamics"):
        AddSrgTendonDriver(DiagramBuilder(), hand.plant, hand.model)
