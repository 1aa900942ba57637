"""The planner of a scenario: its tag, and checks of what the tag chooses."""

import dataclasses as dc

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.carrying.config import CarryTogether
from drake_srg.planning.handover.config import Handover
from drake_srg.planning.insertion.config import Insert
from drake_srg.planning.planner_machine import (
    Clear,
    PickAndPlace,
    PlannerConfig,
)
from drake_srg.planning.servoing.config import Servoing
from drake_srg.scenario import load_scenario, script_of, servo_of
from drake_srg.scenario import schema as module
from drake_srg.scenario.schema import Scenario, accept_planner
from drake_srg.theses.script import Script
from drake_srg.theses.taught import Taught


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("kitchen", PickAndPlace),
        ("kitchen_varied", PickAndPlace),
        ("kitchen_servoing", Servoing),
        ("insert", Insert),
        ("clear_table_tendon", Clear),
        ("row_table", Clear),
        ("assistive_arm_before", Taught),
        ("learn_bench", Script),
        ("thesis_kitchen_tendon", Script),
    ],
)
def test_the_tag_chooses_the_planner(name, kind):
    scenario = load_scenario(name)
    assert type(scenario.planner) is kind
    assert bool(script_of(scenario)) == (kind is Script)
    assert (servo_of(scenario) is not None) == (kind is Servoing)


def test_a_file_without_a_tag_keeps_that_of_its_base(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("base: clear_table\nplanner: {max_attempts: 7}\n")
    scenario = load_scenario(path, overrides=["planner.grip_wait=0.25"])
    assert type(scenario.planner) is Clear
    assert scenario.planner.max_attempts == 7
    assert scenario.planner.grip_wait == 0.25
    assert scenario.planner.cut_corners  # the base's


def test_another_tag_replaces_the_planner_of_the_base(tmp_path):
    path = tmp_path / "mine.yaml"
    steps = "steps: [{duration: 1.0}]"
    path.write_text(f"base: kitchen_fast\nplanner: !Script {{{steps}}}\n")
    planner = load_scenario(path).planner
    assert planner == Script(steps=planner.steps)


@pytest.mark.parametrize(
    ("key", "value", "form"),
    [
        (
            "taught",
            "{lift: [0.0]}",
            "planner: !Taught {lift: [...], place: [...], ...}",
        ),
        ("servoing", "null", "planner: !Servoing {servo: {...}, ...}"),
        ("script", "[{duration: 1.0}]", "planner: !Script {steps: [...]}"),
        ("messages", "{rate: 1.0}", "planner: !Script {messages: {...}}"),
    ],
)
def test_a_key_from_before_there_were_tags_is_told_with_its_new_form(
    tmp_path, key, value, form
):
    path = tmp_path / "mine.yaml"
    path.write_text(f"base: kitchen\n{key}: {value}\n")
    with pytest.raises(ScenarioError) as told:
        load_scenario(path)
    expected = f"{path}: {key}: is a key of the planner now: write {form}"
    assert str(told.value) == expected


@pytest.mark.parametrize(
    ("name", "override", "message"),
    [
        (
            "clear_table",
            "planner=!PickAndPlace {}",
            r"planner: must have the tag !Clear with this task\.pick, got !Pick",
        ),
        ("kitchen", "planner=!Clear {}", r"task\.pick: must be all, .* got 'soup_can'"),
        ("kitchen", "planner=!Cleer {}", r"planner: unknown tag !Cleer \(did you mean"),
        (
            "assistive_arm_thesis",
            "localizer.obstacles=true",
            r"localizer\.obstacles: must be false with taught waypoints",
        ),
        (
            "insert",
            "arm=!ArmPositionDriver {}",
            r"arm: must be !ArmImpedanceDriver with cartesian",
        ),
        ("insert", "task.repeat=2", r"task\.repeat: must be 1 with planner: !Insert"),
        (
            "insert",
            "planner.stiffness=500",
            r"planner\.stiffness: must be that of arm\.cartesian \(2000\)",
        ),
        ("handover", "planner.giver=up", r"planner\.giver: unknown arm 'up' \(allowed"),
        ("handover", "planner.receiver=left", r"planner\.receiver: must not be the"),
        ("handover", "task.repeat=2", r"task\.repeat: must be 1 with planner: !Hand"),
        (
            "kitchen",
            "planner=!Handover {}",
            r"planner\.giver: unknown arm 'left' \(allowed: none\)",
        ),
        (
            "carry_together",
            "planner.first=up",
            r"planner\.first: unknown arm 'up' \(allowed: left, right\)",
        ),
        (
            "carry_together",
            "planner.second=left",
            r"planner\.second: must not be the first, 'left'",
        ),
        (
            "carry_together",
            "arms.left.arm=!ArmPositionDriver {period: 0.01171875}",
            r"arms\.left\.arm: must be !ArmImpedanceDriver for planner: !CarryTog",
        ),
        (
            "carry_together",
            "arms.right.gripper=null",
            r"arms\.right\.gripper: ",
        ),
        (
            "carry_together",
            "planner.max_external_torque=[1,1,1,1,1,1,1]",
            r"planner\.max_external_torque: must be null with planner: !CarryTogether",
        ),
        (
            "clear_table_together",
            "arms={third: {arm: !ArmPositionDriver {}}}",
            r"arms: must be one or two with planner: !Clear, got left, right, third",
        ),
        (
            "clear_table_together",
            "arms.right.gripper=null",
            r"arms\.right\.gripper: must be given with planner: !Clear",
        ),
        (
            "clear_table_together",
            "task.place.bins.left_bin={colour: red}",
            r"task\.place\.bins\.left_bin: must be all with planner: .*, got red",
        ),
        (
            "carry_together",
            "planner=!Clear {period: 0.0234375}",
            r"task\.pick: must be all, .* with planner: !Clear, got 'crate'",
        ),
        (
            "kitchen_impedance",
            "planner=!CarryTogether {}",
            r"planner\.first: unknown arm 'left' \(allowed: none\)",
        ),
        (
            "kitchen_servoing",
            "planner.servo.camera=belly",
            r"planner\.servo\.camera: unknown camera 'belly' \(allowed",
        ),
        (
            "conveyor",
            "planner.window.min=[0.8, 0.0]",
            r"planner\.window: min must be below max, got \[0\.8",
        ),
        (
            "kitchen_servoing",
            "planner.window={min: [0.4, -0.4]}",
            r"planner\.window\.max: must be \[x, y\], got \[\]",
        ),
        (
            "conveyor",
            "planner.search_time=0",
            r"planner\.search_time: must be above 0\.25 s, to look twice, got 0",
        ),
        (
            "conveyor",
            "task.repeat=2",
            r"task\.repeat: must be 1 with planner\.window, because .* got 2",
        ),
        (
            "kitchen_servoing",
            "planner.servo.method=guess",
            r"planner\.servo\.method: must be one of ibvs, pbvs",
        ),
        (
            "kitchen_servoing",
            "planner.servo.camera_period=0.0146484375",
            r"planner\.servo\.camera_period: must be a multiple of planner\.servo",
        ),
        (
            "kitchen_servoing",
            "planner.servo.period=0.01",
            r"planner\.servo\.period: must be a multiple of 1/1024 s",
        ),
    ],
)
def test_mistakes_are_named(name, override, message):
    with pytest.raises(ScenarioError, match=message):
        load_scenario(name, overrides=[override])


def test_a_planner_of_ones_own_is_loaded_by_its_tag(monkeypatch):
    @dc.dataclass(kw_only=True)
    class Juggle(PlannerConfig):
        """A planner's configuration with a key of its own."""

        balls: int = 3

    (field,) = (field for field in dc.fields(Scenario) if field.name == "planner")
    monkeypatch.setattr(field, "type", field.type)
    monkeypatch.setitem(Scenario.__annotations__, "planner", field.type)
    accept_planner(Juggle)
    scenario = load_scenario("kitchen", overrides=["planner=!Juggle {balls: 5}"])
    assert scenario.planner == Juggle(balls=5)
    assert {*module.PLANNERS} == {
        *(
            PickAndPlace,
            Clear,
            Servoing,
            Insert,
            Handover,
            CarryTogether,
            Taught,
            Script,
        )
    }
