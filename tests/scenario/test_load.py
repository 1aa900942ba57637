import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg import scenario as module
from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.scenario import Scenario, list_scenarios, load_scenario
from drake_srg.types import Box, Sphere


@pytest.fixture
def write(tmp_path):
    """Writes a scenario file and returns its path."""

    def write_file(content, name="mine.yaml"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write_file


def error_of(name, **kwargs):
    with pytest.raises(ScenarioError) as error:
        load_scenario(name, **kwargs)
    message = str(error.value)
    assert "\n" not in message
    return message


# Loading.


def test_an_empty_mapping_is_a_scenario_of_defaults(write):
    assert load_scenario(write("{}")).task == Scenario().task
    assert load_scenario(write("")).objects == {}


@pytest.mark.parametrize("seed", [0, 1, 2**70])
@pytest.mark.parametrize("name", list_scenarios())
def test_every_shipped_scenario_loads(name, seed):
    scenario = load_scenario(name, seed=seed)
    assert scenario.random_seed == seed
    for obj in scenario.objects.values():
        assert obj.position is not None or obj.pose is not None


@given(st.integers(0, 2**31))
@settings(max_examples=30)
def test_draws_stay_within_their_bounds(seed):
    can = load_scenario("kitchen", seed=seed).objects["soup_can"]
    assert 0.279 <= can.mass <= 0.419
    assert 0.6 <= can.friction <= 1.0
    assert 0.45 <= can.position[0] <= 0.75
    assert -0.2 <= can.position[1] <= 0.2


def drawn(scenario):
    can = scenario.objects["soup_can"]
    return can.mass, can.friction, *can.position


def test_the_same_seed_draws_the_same():
    assert drawn(load_scenario("kitchen")) == drawn(load_scenario("kitchen", seed=0))
    draws = [drawn(load_scenario("kitchen", seed=s)) for s in range(5)]
    assert len(set(sum(draws, ()))) == 20


@pytest.mark.parametrize(
    "override",
    [
        "planner.latency=!Uniform {min: 0.1, max: 0.2}",
        "task.place.position=!UniformVector {min: [0.5, -0.5], max: [0.6, -0.4]}",
        "object.yaw=!Uniform {min: 0, max: 1}",
        "objects.ball={shape: !Sphere {radius: 0.03}, mass: 0.1, friction: 0.5}",
    ],
)
def test_draws_do_not_depend_on_unrelated_fields(override):
    changed = load_scenario("kitchen", seed=3, overrides=[override])
    assert drawn(changed) == drawn(load_scenario("kitchen", seed=3))


def test_overriding_one_draw_leaves_the_others():
    fixed = load_scenario("kitchen", seed=3, overrides=["object.mass=0.3"])
    assert fixed.objects["soup_can"].mass == 0.3
    assert drawn(fixed)[1:] == drawn(load_scenario("kitchen", seed=3))[1:]


def test_objects_without_a_position_keep_apart():
    balls = [
        f"objects.ball{i}={{shape: !Sphere {{radius: 0.03}}, mass: 1, friction: 1}}"
        for i in range(4)
    ]
    for seed in range(5):
        scenario = load_scenario("kitchen", seed=seed, overrides=balls)
        p = np.array([o.position for o in scenario.objects.values()])
        apart = np.linalg.norm(p[:, None] - p[None], axis=2) + 9.0 * np.eye(5)
        assert np.min(apart) > 0.15


# Overrides.


def test_set_parses_yaml_with_tags():
    scenario = load_scenario(
        "kitchen",
        overrides=[
            "planner.max_attempts=1",
            "object.friction=0",
            "object.covered=true",
            "gripper=!SrgPositionDriver {proximity: {range: 0.1}}",
            "object.model=null",
            "object.shape=!Box {size: [0.05, 0.06, 0.07]}",
            "planner={lift_height: 0.1}",
            "random_seed=5",
        ],
    )
    assert scenario.planner.max_attempts == 1
    assert scenario.planner.lift_height == 0.1
    can = scenario.objects["soup_can"]
    assert (can.friction, can.covered, can.shape) == (
        0.0,
        True,
        Box([0.05, 0.06, 0.07]),
    )
    assert isinstance(scenario.gripper, SrgPositionDriver)
    assert scenario.gripper.proximity.range == 0.1
    assert scenario.random_seed == 5


def test_the_seed_argument_wins():
    assert (
        load_scenario("kitchen", seed=4, overrides=["random_seed=5"]).random_seed == 4
    )


def test_object_is_the_picked_object():
    scenario = load_scenario(
        "kitchen",
        overrides=[
            "objects.ball={shape: !Sphere {radius: 0.03}, mass: 1, friction: 1}",
            "task.pick=ball",
            "object.mass=0.2",
        ],
    )
    assert scenario.objects["ball"].mass == 0.2
    assert scenario.objects["ball"].shape == Sphere(0.03)
    assert scenario.objects["soup_can"].mass != 0.2


def test_set_reaches_into_lists():
    turned = "directives.gripper::palm.add_weld.X_PC.rotation=!Rpy {deg: [0, 0, 90]}"
    scenario = load_scenario("gripper_bench", overrides=[turned, "script.0.duration=2"])
    X_PC = scenario.directives[5].add_weld.X_PC.GetDeterministicValue()
    np.testing.assert_allclose(X_PC.rotation().col(0), [0, 1, 0], atol=1e-12)
    assert scenario.script[0].duration == 2.0


def test_an_object_with_a_pose_gets_no_position():
    pose = "object.pose={translation: [0.5, 0, !Uniform {min: 0.2, max: 0.3}]}"
    can = load_scenario("kitchen", overrides=[pose]).objects["soup_can"]
    assert can.position is None
    assert 0.2 <= can.pose.translation[2] <= 0.3


# Bases.


def test_a_variant_overrides_models_by_name(write):
    path = write("base: kitchen\ndirectives: {gripper: {add_model: {file: x.sdf}}}")
    models = [d.add_model for d in load_scenario(path).directives if d.add_model]
    files = {model.name: model.file for model in models}
    assert files["gripper"] == "x.sdf"
    assert files["arm"] == "package://drake_srg/sdf/iiwa14.sdf"


def test_a_variant_in_the_old_form_is_told_the_name_to_write(write):
    path = write('base: kitchen\ndirectives: {"4": {add_model: {file: x.sdf}}}')
    message = r": directives: .* got '4' \(write 'gripper' instead of '4'; allowed: tab"
    with pytest.raises(ScenarioError, match=message):
        load_scenario(path)


def test_a_variant_lays_its_keys_over_its_base(write):
    write("base: kitchen\nplanner: {latency: 0.3}", "between.yaml")
    path = write("base: between.yaml\nobjects: {soup_can: {mass: 0.3}}")
    scenario = load_scenario(path)
    assert scenario.planner.latency == 0.3
    assert scenario.objects["soup_can"].mass == 0.3
    assert drawn(scenario)[1:] == drawn(load_scenario("kitchen"))[1:]
    assert scenario.cameras.keys() == load_scenario("kitchen").cameras.keys()


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ("3", "base: must be a scenario's name or path"),
        ("[kitchen]", "base: must be a scenario's name or path"),
        ("kitchn", r"unknown scenario 'kitchn' \(allowed: .*kitchen"),
        ("mine.yaml", "base: mine.yaml leads back to itself"),
        ("other.yaml", "base: mine.yaml leads back to itself"),
        ("missing.yaml", "missing.yaml: cannot be read: No such file"),
    ],
)
def test_bad_bases(write, base, message):
    write("base: mine.yaml", "other.yaml")
    assert re.search(message, error_of(write(f"base: {base}")))


# What can be wrong. The content of fields is in test_yaml_typed.py.


@pytest.mark.parametrize("name", ["kitchn", "", "/", "..", "x" * 5000, "a\0b"])
def test_unknown_scenarios(name):
    message = error_of(name)
    assert message.startswith("unknown scenario ")
    assert "kitchen" in message


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe\x00\x01", "mine.yaml: cannot be read: not text in UTF-8"),
        ("a: [1", "mine.yaml: not valid YAML: .*line 1"),
        ("[1, 2]", "mine.yaml: must be a mapping of keys to values"),
        ("hello", "mine.yaml: must be a mapping of keys to values"),
        ("1: 2", "mine.yaml: keys must be text"),
        ("tsk: {}", r"mine.yaml: top level: unknown key 'tsk' \(did you mean 'task'"),
        ("random_seed: [1]", "mine.yaml: random_seed: must be a number"),
    ],
)
def test_bad_files(write, content, message):
    assert re.search(message, error_of(write(content)))


@pytest.mark.parametrize("name", ["missing.yaml", "x" * 5000 + ".yaml", "a\0b.yaml"])
def test_unreadable_paths(tmp_path, name):
    assert "cannot be read" in error_of(tmp_path / name)
    assert "cannot be read" in error_of(name)


def test_a_folder_is_not_a_scenario(tmp_path):
    (tmp_path / "folder.yaml").mkdir()
    assert "cannot be read: Is a directory" in error_of(tmp_path / "folder.yaml")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("object", "--set object: must be KEY=VALUE"),
        ("=3", "--set =3: must be KEY=VALUE"),
        ("object.mass=[", "--set objects.soup_can.mass: not valid YAML: "),
        ("random_seed.x=3", "--set random_seed.x: random_seed is a value without keys"),
        ("object.mas=1", "kitchen: objects.soup_can: unknown key 'mas' (did you mean"),
        ("object.mass=-1", "objects.soup_can.mass: must be greater than 0.0, got -1.0"),
        ("object.mass=heavy", "objects.soup_can.mass: must be a number, got 'heavy'"),
        ("object.mass=.nan", "objects.soup_can.mass: must be a number, got NaN"),
        ("object.resolution=0", "objects.soup_can.resolution: must be greater than 0"),
        ("object.friction=-0.1", "objects.soup_can.friction: must be at least 0.0"),
        (
            "object.mass=!Unifrom {min: 1, max: 2}",
            "mass: unknown tag !Unifrom (did you",
        ),
        (
            "object.position=[9, 0]",
            "position: must be on the table, got [9.0, 0.0] (allowed: ",
        ),
        ("object.position=[0.5]", "position: needs 2 numbers, got 1"),
        ("object.model=null", "objects.soup_can: needs either a model or a shape"),
        ("object.shape=!Sphere {}", "soup_can: needs either a model or a shape"),
        (
            "objects.b={shape: !Sphere {}}",
            "objects.b: an object with a shape needs mass",
        ),
        (
            "gripper=!SrgPositonDriver {}",
            "gripper: unknown tag !SrgPositonDriver (did",
        ),
        (
            "arm=!Sphere {}",
            "arm: must have the tag !ArmPositionDriver or none, got !Sphere",
        ),
        ("task=3", "task: must be a mapping, got 3"),
        (
            "task.pick=cup",
            "task.pick: unknown object 'cup' (allowed: soup_can)",
        ),
        ("task.region={min: [1, 1]}", "task.region: min must not be above max"),
        ("task.region.max=[1.4, 0]", "task.region: must be on the table"),
        (
            "localizer.cameras=[sky]",
            "localizer.cameras: unknown camera 'sky'",
        ),
        (
            "localizer.cameras=[ceiling, '']",
            "localizer.cameras: unknown camera '' (allowed: ceiling, ",
        ),
        (
            "localizer.cameras=[ceiling, ceiling]",
            "localizer.cameras: must name each camera once, got [ceiling, ceiling]",
        ),
        ("recording.bag_cameras=['']", "recording.bag_cameras: unknown camera ''"),
        ("cameras={}", "localizer.cameras: unknown camera 'ceiling'"),
        ("objects={}", "task.pick: unknown object 'soup_can'"),
        ("cameras.ceiling.width=0", "cameras.ceiling.width: must be at least 1 pixel"),
        (
            "cameras.ceiling.focal=!FovDegrees {x: 180}",
            "cameras.ceiling.focal.x: must be between 0 and 180 degrees, got 180.0",
        ),
        ("recording.period=0.1", "recording.period: must be at most 0.05, got 0.1"),
        ("recording.period=1e-4", "recording.period: must be at least 0.001"),
        ("simulator_config.accuracy=0", "simulator_config.accuracy: must be greater"),
        ("simulator_config.max_step_size=-1", "max_step_size: must be greater than"),
        ("recording.video_fps=1e9", "recording.video_fps: must be at most 240.0"),
        ("simulator_config.start_time=-1", "simulator_config.start_time: must be 0.0"),
        ("arm.kp=[-1, 1, 1, 1, 1, 1, 1]", "arm.kp: must be at least 0.0, got -1.0"),
        ("arm.kd=[-1, 1, 1, 1, 1, 1, 1]", "arm.kd: must be at least 0.0, got -1.0"),
        ("recording.video_camera=sky", "allowed: ceiling, overview"),
        (
            "planner.approaches=[below]",
            "planner.approaches: must be one of above, side",
        ),
        ("planner.time_budget=0", "planner.time_budget: must be greater than 0.0"),
        (
            "object.color_range={space: cmyk}",
            "color_range.space: must be one of hsv, rgb",
        ),
        ("gripper.servo.law=pdi", "gripper.servo.law: must be one of pid, printed"),
        ("gripper.trigger=smell", "gripper.trigger: must name a sensor, got 'smell'"),
        (
            "gripper.servo.kp=[1, 2]",
            "gripper.servo.kp: needs one entry per motor (4), got 2",
        ),
        ("gripper.servo.period=0", "gripper.servo.period: must be greater than 0.0"),
        ("gripper.proximity.range=-1", "gripper.proximity.range: must be greater than"),
        ("gripper.minimum_jerk.max_velocity=0", "max_velocity: must be greater than 0"),
        ("arm.period=0", "arm.period: must be greater than 0.0"),
        ("plant_config.time_step=0", "plant_config.time_step: must be greater than 0"),
        ("directives=[3]", "directives[0]: must be a mapping, got 3"),
        (
            "directives.99.x=3",
            "directives: entries are overridden by name, got '99' (allowed: table, ",
        ),
        (
            "directives.table.add_modl.file=x",
            "directives[0]: unknown key 'add_modl' (did you mean 'add_model'",
        ),
        (
            "objects.soup_can={position: [0.5, 0], pose: {}}",
            "objects.soup_can: needs either a pose, or position and yaw",
        ),
        ("object={yaw: 1, pose: {}}", "needs either a pose, or position and yaw"),
        ("script=[{mode: fly}]", "script[0].mode: must be one of close, grasp, home"),
        ("script=[{duration: 0}]", "script[0].duration: must be greater than 0.0"),
        ("script=[{closure: 2}]", "script[0].closure: must be at most 1.0, got 2.0"),
        (
            "script=[{arm: [1]}]",
            "script[0].arm: needs one entry per joint of the arm (7)",
        ),
        (
            "script=[{duration: 50}]",
            "script: must last at most planner.time_budget (40 s)",
        ),
        ("cameras.ceiling.X_PB.translation=[1, 2]", "cameras: cannot be read: "),
    ],
)
def test_bad_overrides_name_key_and_what_is_allowed(override, message):
    assert message in error_of("kitchen", overrides=[override])


@pytest.mark.parametrize("task", ["{}", "3", "{pick: 3}", "{pick: [a]}"])
def test_object_needs_a_picked_object(write, task):
    message = error_of(write(f"task: {task}"), overrides=["object.mass=1"])
    assert message == "--set object.mass: the scenario picks no object"


def test_a_full_region_is_reported():
    tiny = ["task.region={min: [0.5, 0], max: [0.5, 0]}", "object.position=[0.4, 0]"]
    tiny.append("objects.ball={shape: !Sphere {radius: 0.03}, mass: 1, friction: 1}")
    assert "task.region: must be larger, no free place for 'ball'" in error_of(
        "kitchen", overrides=tiny
    )


@pytest.mark.parametrize("seed", [-1, 1.5, "a", np.nan, np.inf])
def test_bad_seeds(seed):
    assert "kitchen: random_seed: must be" in error_of("kitchen", seed=seed)


KEYS = """
object objects task task.pick task.place task.region arm arm.kp gripper cameras
cameras.ceiling cameras.ceiling.X_PB directives planner planner.latency table a.b .
object.mass object.position object.shape object.color random_seed plant_config foo
simulator_config scene_graph_config recording localizer.cameras object."""
VALUES = """\
!Uniform {min: 0, max: 1}|!Uniform {}|!Sphere {}|!Foo {}|.nan|.inf|-1|null|[]
|{}|true|{1: 2}|&a [*a]|1e999|!!set {a}|2001-01-01|{x: {}}|[0.5, 0]|!!binary aGk=
|kitchen
|!UniformVector {min: [0, 0], max: [1, 0]}"""
keys = st.sampled_from(KEYS.split())
values = st.one_of(
    st.text(alphabet="0123456789.-[]{}:, !abefinUx*&'#|", max_size=12),
    st.sampled_from(VALUES.split("|")),
)


@given(st.lists(st.builds("{}={}".format, keys, values), min_size=1, max_size=3))
@settings(max_examples=150)
def test_no_override_raises_anything_but_a_scenario_error(overrides):
    try:
        load_scenario("kitchen", overrides=overrides)
    except ScenarioError as error:
        assert "\n" not in str(error)


def test_the_scenarios_are_listed_by_name():
    assert "kitchen" in list_scenarios()
    for name in list_scenarios():
        assert (module.SCENARIOS / f"{name}.yaml").is_file()


def test_messages_become_the_script():
    scenario = load_scenario("thesis_kitchen")
    duration = sum(step.duration for step in scenario.script)
    messages = scenario.messages
    assert duration == pytest.approx(messages.number() / messages.rate + messages.rest)
    with pytest.raises(ScenarioError, match=r"script: must be empty if"):
        load_scenario("thesis_kitchen", overrides=["script=[{duration: 1.0}]"])
    unknown = "messages.sequence=[{routine: gripp}]"
    with pytest.raises(
        ScenarioError, match=r"unknown routine 'gripp' \(did you mean 'grip'"
    ):
        load_scenario("thesis_kitchen", overrides=[unknown])
