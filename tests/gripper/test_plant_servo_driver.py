import dataclasses as dc

import numpy as np
import pytest
from helpers import port_table
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.gripper import PlantServoDriver
from drake_srg.gripper.underactuation import JOINT_NAMES
from drake_srg.parsing import AddModel
from gripper.driven_hand import SrgHand

FAST = PlantServoDriver()


def test_each_joint_has_its_own_target():
    hand = SrgHand(config=FAST)
    targets = np.array([0.3, 0.2, 0.1, 0.4])
    hand.command(joint_position_commanded=targets)
    hand.advance(0.8)
    # The fingers' weight bends the servos by less than 0.01 rad.
    assert hand.q == pytest.approx(targets, abs=0.01)


def test_an_empty_hand_closes_and_opens_within_its_speed():
    hand = SrgHand(config=FAST)
    hand.command(closure_commanded=0.5)
    fastest = 0.0
    for _ in range(100):
        hand.advance(0.01)
        fastest = max(fastest, np.max(hand.read("state_measured")[4:]))
    assert hand.q == pytest.approx([1.5, 1.5, 0.0, 0.0], abs=0.01)
    assert 0.7 * FAST.no_load_speed < fastest < FAST.no_load_speed
    hand.command(closure_commanded=0.0)
    hand.advance(1.0)
    assert hand.q == pytest.approx([0.0] * 4, abs=0.01)


def test_gains_that_the_plant_does_not_know_are_refused():
    servo = dc.replace(FAST.servo, ki=[1.0] * 4)
    with pytest.raises(ValueError, match=r"gripper\.servo: .* only kp and kd"):
        SrgHand(config=PlantServoDriver(servo=servo))


def test_motors_are_as_strong_as_configured():
    hand = SrgHand(config=PlantServoDriver(motor_strength=0.5))
    limits = {
        a.joint().name(): a.effort_limit()
        for a in map(
            hand.plant.get_joint_actuator, hand.plant.GetJointActuatorIndices()
        )
    }
    assert [limits[name] for name in JOINT_NAMES] == pytest.approx(
        [1.003, 1.003, 0.714, 0.714]
    )


def test_the_distance_sensors_may_be_left_out():
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    model = AddModel(plant, "package://drake_srg/sdf/srg_fast.sdf")
    config = PlantServoDriver(proximity=None)
    config.prepare_plant(plant, model)
    plant.Finalize()
    inputs, outputs = port_table(config.AddDriver(builder, plant, model))
    assert "proximity" not in outputs
    assert "query_object" not in inputs
