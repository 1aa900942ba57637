import functools
import re
from pathlib import Path

import numpy as np
import pytest
from helpers import check_reads_or_refuses, damaged
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.arm.driver import ArmPositionDriver
from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper import SrgPositionDriver
from drake_srg.scenario import Scenario, list_scenarios, load_scenario, load_tree
from drake_srg.scenario.load import draw_scenario
from drake_srg.types import Box, Sphere


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a scenario file and returns its path."""

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


def test_an_arm_without_a_tag_is_position_controlled(write):
    scenario = load_scenario(write("arm: {home: [0.1], period: 0.01}"))
    assert isinstance(scenario.arm, ArmPositionDriver)
    assert (scenario.arm.home, scenario.arm.period) == ([0.1], 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2**70])
@pytest.mark.parametrize("name", list_scenarios())
def test_every_shipped_scenario_loads(name, seed):
    scenario = load_scenario(name, seed=seed)
    assert scenario.random_seed == seed
    for obj in scenario.objects.values():
        assert obj.position is not None or obj.pose is not None


@pytest.mark.slow
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


@pytest.mark.slow
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
def test_draws_do_not_depend_on_other_fields(override):
    changed = load_scenario("kitchen", seed=3, overrides=[override])
    assert drawn(changed) == drawn(load_scenario("kitchen", seed=3))


def test_overriding_one_draw_does_not_change_the_others():
    fixed = load_scenario("kitchen", seed=3, overrides=["object.mass=0.3"])
    assert fixed.objects["soup_can"].mass == 0.3
    assert drawn(fixed)[1:] == drawn(load_scenario("kitchen", seed=3))[1:]


@pytest.mark.slow
def test_objects_without_a_position_are_placed_apart():
    balls = [
        f"objects.ball{i}={{shape: !Sphere {{radius: 0.03}}, mass: 1, friction: 1}}"
        for i in range(4)
    ]
    for seed in range(5):
        scenario = load_scenario("kitchen", seed=seed, overrides=balls)
        p = np.array([o.position for o in scenario.objects.values()])
        apart = np.linalg.norm(p[:, None] - p[None], axis=2) + 9.0 * np.eye(5)
        assert np.min(apart) > 0.15


# Bases.


def test_a_variant_overrides_models_by_name(write):
    file = "package://mine/x.sdf"
    path = write(
        f"base: kitchen\ndirectives: {{gripper: {{add_model: {{file: {file}}}}}}}"
    )
    models = [d.add_model for d in load_scenario(path).directives if d.add_model]
    files = {model.name: model.file for model in models}
    assert files["gripper"] == file
    assert files["arm"] == "package://drake_srg/sdf/iiwa14.sdf"


def test_a_variant_keeps_what_it_does_not_override(write):
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
        ("kitchn", r"unknown scenario 'kitchn' \(did you mean 'kitchen'\? allowed"),
        ("mine.yaml", "base: mine.yaml leads back to itself"),
        ("other.yaml", "base: mine.yaml leads back to itself"),
        ("missing.yaml", "missing.yaml: cannot be read: No such file"),
    ],
)
def test_bad_bases(write, base, message):
    write("base: mine.yaml", "other.yaml")
    assert re.search(message, error_of(write(f"base: {base}")))


@pytest.mark.parametrize(
    ("base", "variant", "message"),
    [
        ("taks: 1", "random_seed: 1", "other.yaml: top level: unknown key 'taks'"),
        (
            "task: {plce: 1}",
            "task: {repeat: 1}",
            "other.yaml: task: unknown key 'plce'",
        ),
        (
            "task: {repeat: x}",
            "random_seed: 1",
            "other.yaml: task.repeat: must be a number",
        ),
        ("task: {repeat: x}", "task: {repeat: y}", "mine.yaml: task.repeat: .*'y'"),
        (
            "random_seed: 1",
            "task: {repeat: y}",
            "mine.yaml: task.repeat: must be a number",
        ),
    ],
)
def test_a_mistake_is_told_with_its_own_file(write, base, variant, message):
    write(f"base: kitchen\n{base}", "other.yaml")
    error = error_of(write(f"base: other.yaml\n{variant}"))
    assert re.search(rf"^(.*/)?{message}", error)


def test_a_mistake_in_an_override_is_not_told_with_a_base(write):
    path = write("base: kitchen")
    with pytest.raises(ScenarioError, match=r"mine\.yaml: task.repeat: must be a num"):
        load_scenario(path, overrides=["task.repeat=x"])


@pytest.mark.parametrize("name", list_scenarios())
def test_any_entry_of_a_scenario_can_be_removed_or_is_missed(write, name):
    """By null in a variant."""
    tree = load_tree(name)
    for key in ("objects", "cameras", "camera_errors", "camera_calibrations", "slides"):
        for entry in tree.get(key) or {}:
            check_removed(write, name, (key, entry))
    for entry in ((tree.get("clutter") or {}).get("kinds")) or {}:
        check_removed(write, name, ("clutter", "kinds", entry))


def check_removed(write, name, path):
    *above, entry = path
    text = "{" + ": {".join(path) + ": null" + "}" * len(path)
    tree = load_tree(write(f"base: {name}\n{text[1:-1]}"))
    try:
        drawn = draw_scenario(tree, name, None)
    except ScenarioError as error:
        assert entry in str(error) or "task" in str(error), error
        return
    assert entry not in functools.reduce(getattr, above, drawn.scenario)
    kinds = [kind for key, kind in drawn.values.items() if key.endswith(".kind")]
    assert entry not in kinds


# Mistakes in files and names. For those in values, see test_checks.py and
# test_yaml_typed.py.


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
        ("random_seed: [1]", "mine.yaml: random_seed: must be a"),
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


@pytest.mark.parametrize("task", ["{}", "3", "{pick: 3}", "{pick: [a]}"])
def test_object_needs_a_picked_object(write, task):
    message = error_of(write(f"task: {task}"), overrides=["object.mass=1"])
    assert message == "--set object.mass: the scenario picks no object"


@pytest.mark.parametrize("seed", [-1, 1.5, "a", np.nan, np.inf])
def test_bad_seeds(seed):
    assert "kitchen: random_seed: must be" in error_of("kitchen", seed=seed)


@pytest.mark.slow
def test_messages_become_the_script():
    scenario = load_scenario("thesis_kitchen")
    duration = sum(step.duration for step in scenario.planner.steps)
    messages = scenario.planner.messages
    assert duration == pytest.approx(messages.number() / messages.rate + messages.rest)
    with pytest.raises(ScenarioError, match=r"planner\.steps: must be empty if"):
        load_scenario("thesis_kitchen", overrides=["planner.steps=[{duration: 1.0}]"])
    unknown = "planner.messages.sequence=[{routine: gripp}]"
    with pytest.raises(
        ScenarioError, match=r"unknown routine 'gripp' \(did you mean 'grip'"
    ):
        load_scenario("thesis_kitchen", overrides=[unknown])


def test_paths_of_models_are_relative_to_their_own_file(tmp_path, monkeypatch):
    (tmp_path / "bases").mkdir()
    base = tmp_path / "bases" / "base.yaml"
    base.write_text(
        "objects: {a: {model: a.obj}, b: {model: b.obj}, c: {model: package://d/c.obj}}\n"
        "clutter: {kinds: {k: {model: ../k.obj}}}\n"
    )
    path = tmp_path / "mine.yaml"
    path.write_text("base: bases/base.yaml\nobjects: {b: {model: b.obj}}\n")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    tree = load_tree(path, ["objects.d={model: d.obj}"])
    found = {name: entry["model"] for name, entry in tree["objects"].items()}
    assert found == {
        "a": str(tmp_path / "bases" / "a.obj"),
        "b": str(tmp_path / "b.obj"),
        "c": "package://d/c.obj",
        "d": str(tmp_path / "here" / "d.obj"),
    }
    kind = tree["clutter"]["kinds"]["k"]["model"]
    assert kind == str(tmp_path / "bases" / ".." / "k.obj")


@pytest.mark.parametrize(
    "text",
    [
        "directives: [{add_model: {name: arm, file: my arm.sdf}}]",
        "base: kitchen\ndirectives: {arm: {add_model: {file: my arm.sdf}}}",
    ],
)
def test_paths_of_directives_are_relative_to_their_own_file(tmp_path, text):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    added = [d["add_model"] for d in load_tree(path)["directives"] if "add_model" in d]
    (file,) = [model["file"] for model in added if model["name"] == "arm"]
    assert file == f"file://{tmp_path / 'my arm.sdf'}"


FILE = b"""# ours
base: kitchen
random_seed: 3
objects:
  soup_can: &x {mass: !Uniform {min: 0.2, max: 0.4}, friction: 0.6}
  mug: {model: package://drake_srg/sdf/mug.sdf, position: [0.6, 0.1]}
task: {pick: soup_can, repeat: 2, region: {min: [0.5, -0.2], max: [0.7, 0.2]}}
directives: {gripper: {add_model: {file: package://drake_srg/sdf/srg.sdf}}}
"""


@settings(max_examples=60)
@given(data=st.data())
def test_a_broken_file_gets_one_line(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("scenario") / "mine.yaml"
    path.write_bytes(data.draw(damaged(FILE)))
    check_reads_or_refuses(load_scenario, path, KITCHEN)


KITCHEN = Path("kitchen.yaml")  # the base may miss what is removed


def test_values_of_overrides_are_yaml_with_tags():
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


def test_the_seed_argument_beats_an_override():
    assert (
        load_scenario("kitchen", seed=4, overrides=["random_seed=5"]).random_seed == 4
    )


def test_object_means_the_picked_object():
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


def test_overrides_reach_into_lists():
    turned = "directives.gripper::palm.add_weld.X_PC.rotation=!Rpy {deg: [0, 0, 90]}"
    scenario = load_scenario(
        "gripper_bench", overrides=[turned, "planner.steps.0.duration=2"]
    )
    X_PC = scenario.directives[5].add_weld.X_PC.GetDeterministicValue()
    np.testing.assert_allclose(X_PC.rotation().col(0), [0, 1, 0], atol=1e-12)
    assert scenario.planner.steps[0].duration == 2.0


def test_an_object_with_a_pose_gets_no_position():
    pose = "object.pose={translation: [0.5, 0, !Uniform {min: 0.2, max: 0.3}]}"
    can = load_scenario("kitchen", overrides=[pose]).objects["soup_can"]
    assert can.position is None
    assert 0.2 <= can.pose.translation[2] <= 0.3
