"""Several arms in one station: names, drivers, safety, noise and refusals."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from helpers import port_table

from drake_srg.common.exceptions import ScenarioError
from drake_srg.export import export_scenario
from drake_srg.scenario import load_scenario, robot_arms
from drake_srg.simulation import Rig
from drake_srg.station import MakeCell, MakeStation
from station.two_arm_station import two_arms


@pytest.fixture(scope="module")
def scenario():
    scenario = two_arms()
    scenario.cameras.clear()
    return scenario


def test_ports_begin_with_the_arms_names(scenario):
    inputs, outputs = port_table(MakeStation(scenario))
    for name in ("left", "right"):
        assert inputs[f"{name}.position_commanded"] == 7
        assert inputs[f"{name}.gripper.closure_commanded"] == 1
        assert outputs[f"{name}.state_measured"] == 14
        assert outputs[f"{name}.state_cheat"] == 14
        assert outputs[f"{name}.gripper.state_measured"] == 8
        assert outputs[f"{name}.gripper.grasped"] == 1
    both = [*inputs, *outputs]
    assert not [port for port in both if port.startswith(("arm.", "gripper."))]


def test_one_named_arm_has_the_ports_of_an_unnamed_one():
    single = port_table(MakeStation(load_scenario("kitchen_fast")))
    several = port_table(MakeStation(two_arms()))
    for one, both in zip(single, several, strict=True):
        renamed = {
            port.replace("arm.", "left.", 1)
            if port.startswith("arm.")
            else port.replace("gripper.", "left.gripper.", 1)
            for port in one
            if port.startswith(("arm.", "gripper."))
        }
        assert renamed == {port for port in both if port.startswith("left.")}


def test_each_arm_obeys_its_own_commands():
    scenario = two_arms()
    scenario.plant_config.time_step = 0.002
    scenario.simulator_config.integration_scheme = "runge_kutta3"
    home = np.array(scenario.arms["left"].arm.home)
    away = home + np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1])
    for robot in robot_arms(scenario):
        robot.gripper.servo.law = "pid"
        robot.gripper.servo.period = robot.arm.period = 0.005
    with Rig(scenario, period=0.005) as rig:
        rig.fix("right.position_commanded", away)
        rig.fix("left.gripper.closure_commanded", 0.5)
        rig.advance(1.0)
        q = {name: rig.measured(f"{name}.state_measured")[:7] for name in scenario.arms}
        fingers = {
            name: rig.measured(f"{name}.gripper.state_measured")[:4]
            for name in scenario.arms
        }
    np.testing.assert_allclose(q["left"], home, atol=2e-3)
    np.testing.assert_allclose(q["right"], away, atol=2e-3)
    assert np.all(fingers["left"][:2] > 0.5)
    assert np.all(np.abs(fingers["right"]) < 0.05)


def test_arms_have_noise_of_their_own():
    def noisy(tree):
        for each in tree["arms"].values():
            each["arm"] = {**each["arm"], "errors": {"encoder_noise": 1e-3}}
            each["gripper"] = {**each["gripper"], "errors": {"encoder_noise": 1e-3}}

    station = MakeStation(two_arms(noisy))
    context = station.CreateDefaultContext()
    errors = {}
    for name in ("left", "right"):
        for part in (name, f"{name}.gripper"):
            driver = station.GetSubsystemByName(
                f"{name}_gripper_driver" if "." in part else f"{name}_arm_driver"
            )
            encoders = "encoder_errors" if "." in part else "encoders"
            system = driver.GetSubsystemByName(encoders)
            noise = system.GetMyMutableContextFromRoot(context)
            noise.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(noise))
            errors[part] = noise.get_discrete_state(0).value().copy()
    drawn = list(errors.values())
    assert all(np.any(error != 0.0) for error in drawn)
    for first, second in (("left", "right"), ("left.gripper", "right.gripper")):
        assert not np.any(errors[first] == errors[second])


def test_each_arm_may_have_a_safety_monitor():
    def watched(tree):
        tree["arms"]["right"]["safety"] = {}

    inputs, outputs = port_table(MakeStation(two_arms(watched)))
    assert "right.safety.estop" in inputs
    assert "right.safety.state" in outputs
    assert "right.position_allowed" in outputs
    assert not [port for port in (*inputs, *outputs) if port.startswith("left.safety")]


def refused(change, make=MakeStation):
    with pytest.raises(ScenarioError) as error:
        make(two_arms(change))
    message = str(error.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda tree: tree.update(arm={"home": [0.0] * 7}), "arm: must be null with"),
        (
            lambda tree: tree["arms"]["left"].update(gripper=None),
            "directives: left.gripper: has motors that nothing drives",
        ),
        (lambda tree: tree["arms"].pop("right"), "directives: right: has motors"),
        (
            lambda tree: tree["arms"].update(third=tree["arms"]["left"]),
            "arms.third.arm: needs a model named third",
        ),
        (
            lambda tree: tree["arms"].update(gripper=tree["arms"].pop("left")),
            "arms.gripper: must have another name",
        ),
        (lambda tree: tree["arms"]["left"].pop("arm"), "arms.left.arm: must be given"),
        (
            lambda tree: tree["arms"]["left"].update(driver={}),
            "arms.left: unknown key 'driver'",
        ),
        (
            lambda tree: tree["arms"]["left"]["gripper"].update(trigger="sonar"),
            "arms.left.gripper.trigger: must name a sensor",
        ),
        (
            lambda tree: tree["arms"]["left"]["arm"].update(home=[0.0]),
            "arms.left.arm.home",
        ),
    ],
)
def test_mistakes_are_told_with_the_arms_name(change, words):
    assert words in refused(change)


def test_a_planner_of_one_arm_refuses_several():
    message = refused(lambda tree: None, MakeCell)
    assert message.startswith("arms: planner: !PickAndPlace takes one arm")


def test_exports_refuse_several_arms(tmp_path, scenario):
    out = tmp_path / "out"
    with pytest.raises(ScenarioError, match="export takes one arm") as error:
        export_scenario(scenario, "urdf", out)
    assert "\n" not in str(error.value)
    assert not Path(out).exists()


def test_a_driver_of_ones_own_is_accepted_for_each_arm():
    from drake_srg.gripper.srg_position_driver import SrgPositionDriver
    from drake_srg.scenario.schema import accept_driver

    @dc.dataclass(kw_only=True)
    class MyOwnGripper(SrgPositionDriver):
        grip: float = 0.5

    accept_driver(MyOwnGripper)

    def own(tree):
        gripper = {**tree["arms"]["right"]["gripper"], "_tag": "!MyOwnGripper"}
        tree["arms"]["right"]["gripper"] = {**gripper, "grip": 0.7}

    right = two_arms(own).arms["right"].gripper
    assert isinstance(right, MyOwnGripper)
    assert right.grip == 0.7
