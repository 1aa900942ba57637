import numpy as np
import pytest
from helpers import fix, port_table
from pydrake.systems.analysis import Simulator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.safety_states import describe_safety
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.station import MakeStation

PROFILE = "{profile: {hand: {transient: 90, quasi_static: 40}}, regions: [hand]}"
HOME = [0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0]


def make(*overrides, seed=0):
    return MakeStation(load_scenario("kitchen", seed=seed, overrides=overrides))


@pytest.fixture(scope="module")
def station():
    return make()


def second_arm():
    """The kitchen with another arm beside the first."""
    from drake_srg.scenario.load import draw_scenario, load_tree

    tree = load_tree("kitchen")
    file = "package://drake_srg/sdf/iiwa14.sdf"
    tree["directives"] += [
        {"add_model": {"name": "left", "file": file}},
        {"add_weld": {"parent": "table::table_top", "child": "left::link_0"}},
    ]
    return draw_scenario(tree, "mine.yaml", None).scenario


@pytest.mark.parametrize(
    ("scenario", "name"),
    [
        (second_arm, "left"),
        (lambda: load_scenario("kitchen", overrides=["arm=null"]), "arm"),
        (lambda: load_scenario("kitchen", overrides=["gripper=null"]), "gripper"),
    ],
)
def test_a_model_with_motors_that_nothing_drives_is_refused(scenario, name):
    with pytest.raises(ScenarioError) as error:
        MakeStation(scenario())
    message = str(error.value)
    assert message.startswith(f"directives: {name}: has motors that nothing drives")
    assert "\n" not in message


def camera_ports(name):
    return [
        f"camera_{name}.{port}"
        for port in ("color_image", "depth_image", "body_pose_in_world")
    ]


def test_the_ports_are_as_documented(station):
    # 4 finger joints (n), 4 finger sensors (m) and 7 joints of the arm (N).
    assert port_table(station) == (
        {
            "gripper.closure_commanded": 1,
            "gripper.joint_position_commanded": 4,
            "gripper.hold": 1,
            "gripper.force_limit": 1,
            "arm.position_commanded": 7,
            "object_forces_cheat": None,
        },
        {
            "gripper.state_measured": 8,
            "gripper.pwm": 4,
            "gripper.proximity": 4,
            "gripper.contact_force": 4,
            "gripper.contact_wrench": 24,
            "gripper.grasped": 1,
            "arm.state_measured": 14,
            "arm.torque_measured": 7,
            "arm.state_cheat": 14,
            **dict.fromkeys(camera_ports("ceiling") + camera_ports("fingers")),
            **dict.fromkeys(camera_ports("overview")),
            "object_poses_cheat": None,
            "contact_results_cheat": None,
            "plant_state_cheat": 35,
        },
    )


def test_there_are_no_ports_for_missing_parts():
    without = ["directives.gripper=null", "directives.gripper::palm=null"]
    scenario = load_scenario("kitchen", overrides=["gripper=null", *without])
    scenario.cameras.clear()
    inputs, outputs = port_table(MakeStation(scenario))
    assert set(inputs) == {"arm.position_commanded", "object_forces_cheat"}
    assert set(outputs) == {
        "arm.state_measured",
        "arm.torque_measured",
        "arm.state_cheat",
        "object_poses_cheat",
        "contact_results_cheat",
        "plant_state_cheat",
    }


def test_an_empty_scenario_makes_a_station():
    station = MakeStation(Scenario())
    assert port_table(station) == (
        {"object_forces_cheat": None},
        {
            "object_poses_cheat": None,
            "contact_results_cheat": None,
            "plant_state_cheat": 0,
        },
    )
    Simulator(station).AdvanceTo(0.01)


def test_the_arm_starts_at_home_and_the_object_at_its_position(station):
    context = station.CreateDefaultContext()
    state = station.GetOutputPort("arm.state_measured").Eval(context)
    np.testing.assert_array_equal(state, HOME + [0.0] * 7)
    fingers = station.GetOutputPort("gripper.state_measured").Eval(context)
    np.testing.assert_array_equal(fingers, np.zeros(8))
    poses = station.GetOutputPort("object_poses_cheat").Eval(context)
    x, y = load_scenario("kitchen").objects["soup_can"].position
    # The can's centre stands half its height, 101.8 mm, above the table.
    assert poses.keys() == {"soup_can"}
    assert poses["soup_can"].translation() == pytest.approx([x, y, 0.0509], abs=1e-4)


def test_optional_inputs_can_be_left_unconnected(station):
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    fix(
        station,
        context,
        **{"arm.position_commanded": HOME, "gripper.closure_commanded": 0.1},
    )
    simulator.AdvanceTo(0.3)
    q = station.GetOutputPort("gripper.state_measured").Eval(context)[:4]
    assert q == pytest.approx([0.3, 0.3, 0.0, 0.0], abs=0.03)
    can = station.GetOutputPort("object_poses_cheat").Eval(context)["soup_can"]
    assert can.translation()[2] == pytest.approx(0.0509, abs=2e-4)  # it stands


def start_pose(name, *overrides):
    """Return the pose in world of a scenario's picked object at the start."""
    scenario = load_scenario(name, overrides=overrides)
    scenario.cameras.clear()
    station = MakeStation(scenario)
    context = station.CreateDefaultContext()
    poses = station.GetOutputPort("object_poses_cheat").Eval(context)
    return poses[scenario.task.pick]


def test_an_object_may_start_in_the_hand():
    X_WO = start_pose(
        "gripper_bench",
        "object.position=null",
        "object.pose={base_frame: 'gripper::palm', translation: [0.12, 0, 0]}",
    )
    # The palm is 0.4 m above the table at (0.5, 0) and points down.
    np.testing.assert_allclose(X_WO.translation(), [0.5, 0, 0.28], atol=1e-12)
    np.testing.assert_allclose(X_WO.rotation().col(0), [0, 0, -1], atol=1e-12)


def test_a_base_frame_must_exist():
    with pytest.raises(
        ScenarioError, match=r"objects\.soup_can\.pose\.base_frame: .*foo"
    ):
        start_pose(
            "gripper_bench",
            "object.position=null",
            "object.pose={base_frame: 'gripper::foo'}",
        )


def test_an_absent_object_has_no_pose():
    scenario = load_scenario("kitchen", overrides=["object.present=false"])
    scenario.cameras.clear()
    station = MakeStation(scenario)
    context = station.CreateDefaultContext()
    assert station.GetOutputPort("object_poses_cheat").Eval(context) == {}


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "directives=[{add_model: {name: x, file: package://no/x.sdf}}]",
            "directives: ",
        ),
        ("object.model=package://drake_srg/sdf/srg.sdf", "must have one link, got 5"),
        ("object.model=package://drake_srg/sdf/no.sdf", "objects.soup_can.model: "),
        ("safety={speed: [1, 2]}", "safety.speed: needs 1 entry or one per joint"),
        ("safety={tool: palm, tool_speed: 1}", "safety.tool: must be a frame"),
    ],
)
def test_unsuitable_models_are_reported_with_their_key(override, message):
    with pytest.raises(ScenarioError) as error:
        make(override)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_safety_monitor_adds_its_ports(station):
    inputs, outputs = port_table(make("safety={force: " + PROFILE + "}"))
    names = ("estop", "release", "speed_override", "heartbeat")
    own = {f"safety.{name}": 1 for name in names}
    assert inputs == {**port_table(station)[0], **own}
    assert outputs == {
        **port_table(station)[1],
        "arm.position_allowed": 7,
        "arm.position_held": 7,
        "arm.external_torque": 7,
        "safety.state": 2,
        "safety.speed_scale": 1,
    }


def test_a_command_that_jumps_does_not_reach_the_driver():
    station = make("safety={}", "object.present=false")
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    fix(
        station,
        context,
        **{
            "arm.position_commanded": np.add(HOME, 0.1),
            "gripper.closure_commanded": 0.0,
        },
    )
    simulator.AdvanceTo(0.05)
    measured = station.GetOutputPort("arm.state_measured").Eval(context)
    np.testing.assert_allclose(measured[:7], HOME, atol=1e-3)
    allowed = station.GetOutputPort("arm.position_allowed").Eval(context)
    np.testing.assert_array_equal(allowed, HOME)
    state = station.GetOutputPort("safety.state").Eval(context)
    assert describe_safety(state) == "protective_stop: speed"
