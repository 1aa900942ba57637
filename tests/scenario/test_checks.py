"""Scenarios that clear a table of many objects."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import Scenario, checks, load_scenario
from drake_srg.scenario.checks import check_scenario
from drake_srg.theses.script import ScriptStep


def test_all_are_the_names_of_all_objects():
    task = load_scenario("clear_table", overrides=["clutter.count=3"]).task
    assert task.pick == ""
    assert task.clear.objects == ["clutter_1", "clutter_2", "clutter_3"]


def test_all_leave_out_what_is_absent():
    overrides = ["objects.red_can.present=false"]
    task = load_scenario("sort_table", overrides=overrides).task
    assert len(task.clear.objects) == 6
    assert "red_can" not in task.clear.objects


@pytest.mark.parametrize(
    ("pick", "names", "colour", "objects"),
    [
        ("all", [], "", 7),
        ("red_can", ["red_can"], "", 1),
        ("[red_can, blue_ball]", ["red_can", "blue_ball"], "", 2),
        ("{colour: red}", [], "red", 7),
    ],
)
def test_what_is_picked_for_a_bin(pick, names, colour, objects):
    overrides = [f"task.pick={pick}", "task.place={bin: red_bin, bins: null}"]
    task = load_scenario("sort_table", overrides=overrides).task
    (selection,) = task.place.bins.values()
    assert (selection.names, selection.colour) == (names, colour)
    assert len(task.clear.objects) == objects


def test_a_row_has_a_place_for_each_name():
    task = load_scenario("row_table").task
    assert task.clear.objects == ["red_block", "red_can", "blue_block", "blue_can"]
    assert task.place.bins == {}


def test_a_list_may_name_the_one_object_to_place():
    task = load_scenario("kitchen", overrides=["task.pick=[soup_can]"]).task
    assert task.pick == "soup_can"


@pytest.mark.parametrize(
    ("scenario", "override", "message"),
    [
        ("clear_table", "clutter.count=0", "task.pick: needs at least one object"),
        ("clear_table", "clutter.count=40", "task.region: must be larger, no free"),
        ("clear_table", "task.pick=spoon", "task.pick: unknown object 'spoon'"),
        ("clear_table", "task.pick=[spoon]", "task.pick: unknown object 'spoon'"),
        ("clear_table", "task.pick=[]", "task.pick: must name at least one object"),
        ("clear_table", "task.pick=[[]]", "task.pick: unknown object a list"),
        ("clear_table", "task.pick=null", "{colour: COLOUR}, got null"),
        ("clear_table", "task.pick={color: red}", "{colour: COLOUR}, got a mapping"),
        (
            "clear_table",
            "task.pick={colour: rde}",
            "task.pick.colour: unknown 'rde' (did you mean",
        ),
        (
            "clear_table",
            "task.pick=[clutter_1]",
            "objects.clutter_1.known: must be true",
        ),
        ("sort_table", "task.pick=red_can", "must be all with task.place.bins, got"),
        ("sort_table", "task.pick=[red_ball, red_ball]", "must be all with task.place"),
        ("sort_table", "task.place.bin=red_bin", "needs one of bin, bins and row"),
        ("row_table", "task.pick=all", "must be a list of names with task.place.row"),
        ("row_table", "task.place.bin=table", "needs one of bin, bins and row, got"),
        (
            "sort_table",
            "task.place={bin: [red_bin], bins: null}",
            "task.place.bin: must be text, got a list",
        ),
        ("clear_table", "task.place.row={}", "one of bin, bins and row, got bin and"),
        ("row_table", "task.place.row=3", "task.place.row: must be a mapping"),
        ("sort_table", "task.place.bins=3", "task.place.bins: must be a mapping"),
        (
            "sort_table",
            "task.place.bins.blue_bin.colour=red",
            "task.place.bins.red_bin: must not take 'red', which 'blue_bin' takes",
        ),
        (
            "sort_table",
            "task.place.bins.blue_bin.names=[red_can]",
            "task.place.bins.blue_bin: needs either names or a colour",
        ),
        ("sort_table", "task.place.bins.red_bin=[can]", "bins.red_bin: unknown object"),
        ("sort_table", "task.place.bins.left=[red_can]", "unknown model 'left'"),
        ("clear_table", "clutter=null", "task.pick: needs at least one object"),
        ("clear_table", "objects=3", "objects: must be a mapping, got 3"),
        ("clear_table", "clutter.kinds=null", "clutter.kinds: must be a mapping"),
        ("clear_table", "clutter.kinds.mug=3", "clutter.kinds.mug: must be a mapping"),
        ("clear_table", "task.clear=5", "task.clear: must be "),
        ("clear_table", "task.clear.objects=[a]", "task.clear.objects: must be absent"),
        (
            "clear_table",
            "task.place.bin=basket",
            "task.place.bin: unknown model 'basket' (allowed: bin, floor, ",
        ),
        ("clear_table", "task.place.bin=''", "task.place.bin: must name the bin"),
        ("clear_table", "task.clear.region.max=[0, 0]", "region: min must be below"),
        ("clear_table", "task.clear.region.max=[2, 1]", "region: must be on the table"),
        ("kitchen", "task.place.cameras=[ceiling]", "cameras: needs task.place.bin"),
        (
            "clear_table",
            "task.place.cameras=[bon]",
            "task.place.cameras: unknown camera 'bon' (allowed: bin, ceiling, fingers",
        ),
        ("kitchen", "task.pick=all", "task.place.bin: must name the bin"),
        ("kitchen", "task.pick=[soup_can, a]", "task.pick: must name one object with"),
        ("kitchen", "task.pick={colour: red}", "task.place.bin: must name the bin for"),
        ("kitchen", "object.tilt=[1, 0]", "soup_can.tilt: needs drop"),
    ],
)
def test_mistakes_are_named(scenario, override, message):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(scenario, overrides=[override])
    text = str(caught.value)
    assert text.startswith(f"{scenario}: ")
    assert message in text
    assert "\n" not in text


def error_of(*overrides):
    with pytest.raises(ScenarioError) as error:
        load_scenario("kitchen", overrides=overrides)
    message = str(error.value)
    assert "\n" not in message
    return message


def test_a_loaded_scenario_passes():
    for name in ("kitchen", "gripper_bench"):
        check_scenario(load_scenario(name), name)


def test_a_scenario_changed_in_python_can_be_checked():
    bench = load_scenario("gripper_bench")
    bench.planner.steps.append(ScriptStep(arm=[0.0]))
    i = len(bench.planner.steps) - 1
    message = rf"^mine: planner\.steps\[{i}\]\.arm: .* the arm \(3\), got 1"
    with pytest.raises(ScenarioError, match=message):
        check_scenario(bench, "mine")


def test_an_approximation_that_this_drake_lacks_is_refused(monkeypatch):
    override = "plant_config.discrete_contact_approximation=tamsi"
    monkeypatch.setattr(checks, "contact_approximations", lambda: ["sap", "tamsi"])
    load_scenario("gripper_bench", overrides=[override])
    monkeypatch.setattr(checks, "contact_approximations", lambda: ["lagged", "sap"])
    message = "discrete_contact_approximation: unknown 'tamsi' (allowed: lagged, sap)"
    assert error_of(override) == f"kitchen: plant_config.{message}"


def test_the_defaults_pass():
    check_scenario(Scenario(), "defaults")


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
        (
            "objects.x={shape: !Box {size: [3, 1, 1]}, mass: 1, friction: 1}",
            "x.shape: must fit on the table, got 3 x 1 m (allowed: up to 1.7 x 1.6 m)",
        ),
        ("object.scale=0", "objects.soup_can.scale: must be greater than 0.0, got 0"),
        ("object.pieces=0", "objects.soup_can.pieces: must be at least 1, got 0"),
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
            "arm: unknown tag !Sphere (allowed: !ArmImpedanceDriver, !ArmPosition",
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
        ("recording.inset_camera=sky", "recording.inset_camera: unknown camera 'sky'"),
        ("recording.video_camera=sky", "allowed: ceiling, fingers, overview"),
        (
            "planner.approaches=[below]",
            "planner.approaches: must be one of above, side",
        ),
        ("planner.time_budget=0", "planner.time_budget: must be greater than 0.0"),
        (
            "object.color_range={space: cmyk}",
            "color_range.space: must be one of hsv, rgb",
        ),
        (
            "gripper.servo.law=pdi",
            "gripper.servo.law: must be one of literal, pid, plant, printed; got 'pdi'",
        ),
        ("gripper.servo.pwm_steps=-1", "gripper.servo.pwm_steps: must be at least 0"),
        ("gripper.servo.pwm_steps=1.5", "gripper.servo.pwm_steps: must be "),
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
            "directives.table.add_weld={parent: world, child: 'table::table'}",
            "directives[0]: needs one of add_collision_filter_group, add_directives, "
            "add_frame, add_model, add_model_instance, add_weld; got add_model and "
            "add_weld",
        ),
        (
            "directives.table.add_modl.file=x",
            "directives[0]: unknown key 'add_modl' (did you mean 'add_model'",
        ),
        (
            "objects.soup_can={position: [0.5, 0], pose: {}}",
            "objects.soup_can: needs either a pose, or position, yaw and drop",
        ),
        ("object={yaw: 1, pose: {}}", "needs either a pose, or position, yaw and drop"),
        (
            "planner=!Script {steps: [{mode: fly}]}",
            "planner.steps[0].mode: must be one of close, grasp, home",
        ),
        (
            "planner=!Script {steps: [{duration: 0}]}",
            "planner.steps[0].duration: must be greater than 0.0",
        ),
        (
            "planner=!Script {steps: [{closure: 2}]}",
            "planner.steps[0].closure: must be at most 1.0, got 2.0",
        ),
        (
            "planner=!Script {steps: [{arm: [1]}]}",
            "planner.steps[0].arm: needs one entry per joint of the arm (7)",
        ),
        (
            "planner=!Script {steps: [{duration: 50}]}",
            "planner.steps: must last at most planner.time_budget (40 s)",
        ),
        ("cameras.ceiling.X_PB.translation=[1, 2]", "cameras: cannot be read: "),
    ],
)
def test_a_bad_override_is_reported_with_its_key_and_what_is_allowed(override, message):
    assert message in error_of(override)


def test_a_full_region_is_reported():
    tiny = ["task.region={min: [0.5, 0], max: [0.5, 0]}", "object.position=[0.4, 0]"]
    tiny.append("objects.ball={shape: !Sphere {radius: 0.03}, mass: 1, friction: 1}")
    assert "task.region: must be larger, no free place for 'ball'" in error_of(*tiny)


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


@pytest.mark.slow
@given(st.lists(st.builds("{}={}".format, keys, values), min_size=1, max_size=3))
@settings(max_examples=150)
def test_bad_overrides_only_raise_scenario_errors(overrides):
    try:
        load_scenario("kitchen", overrides=overrides)
    except ScenarioError as error:
        assert "\n" not in str(error)


SPONGE = "objects={sponge: {shape: !Box {}, soft: {}, mass: 0.1, friction: 1}}"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["sleeping={period: 0.001}"],
            "sleeping.period: must be at least plant_config.time_step (0.002 s), got",
        ),
        (
            [
                "sleeping={}",
                "task.pick=sponge",
                SPONGE,
                "plant_config.discrete_contact_approximation=sap",
            ],
            "sleeping: must be null with soft objects",
        ),
    ],
)
def test_sleeping_that_cannot_be_is_refused(overrides, message):
    assert message in error_of(*overrides)


def test_nothing_sleeps_with_the_continuous_integrator():
    with pytest.raises(ScenarioError, match="sleeping: must be null with integrator"):
        load_scenario("kitchen_fast", overrides=["sleeping={}"])
