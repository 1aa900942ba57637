"""The planner of a cell that clears its table."""

from pathlib import Path

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.clearing.clearing_planner import ClearingPlanner
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.scenario import load_scenario
from drake_srg.scenario.load import load_tree
from drake_srg.station.clearing import (
    MakeClearingPair,
    MakeClearingPlanner,
    MakeReach,
    shares_of,
)
from drake_srg.station.perception import bin_boxes

FAR = "directives.bin::bottom.add_weld.X_PC.translation=[1.2, -0.5, 0.0]"


def test_a_bin_out_of_reach_is_told():
    scenario = load_scenario("clear_table", overrides=["clutter.count=1", FAR])
    with pytest.raises(ScenarioError, match=r"^task\.place\.bin: out of reach: "):
        MakeClearingPlanner(scenario)


def test_a_bin_without_walls_is_refused(tmp_path):
    path = tmp_path / "ghost.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='bottom'/></model></sdf>"
    )
    ghost = f"directives.bin.add_model.file={path.as_uri()}"
    scenario = load_scenario("clear_table", overrides=["clutter.count=1", ghost])
    with pytest.raises(ScenarioError, match=r"^task\.place\.bin: 'bin' has no fixed"):
        bin_boxes(scenario)


@pytest.mark.parametrize("make", [MakeClearingPlanner, MakeReach])
def test_a_gripper_that_does_not_pinch_from_above_is_refused(monkeypatch, make):
    monkeypatch.setattr(SrgHand, "pinch", None)
    scenario = load_scenario("clear_table", overrides=["clutter.count=1"])
    with pytest.raises(ScenarioError, match=r"^gripper: must pinch from above"):
        make(scenario)


def test_a_table_that_the_hand_does_not_reach_has_no_ring():
    region = "task.clear.region={min: [1.1, -0.1], max: [1.3, 0.1]}"
    scenario = load_scenario("clear_table", overrides=["clutter.count=1", region])
    with pytest.raises(ScenarioError, match=r"^task\.clear\.region: the hand must"):
        MakeReach(scenario)


@pytest.mark.parametrize("name", ["table", "floor"])
def test_furniture_is_no_bin(name):
    overrides = ["clutter.count=1", f"task.place.bin={name}"]
    scenario = load_scenario("clear_table", overrides=overrides)
    with pytest.raises(ScenarioError, match=rf"^task\.place\.bin: '{name}' is too low"):
        MakeClearingPlanner(scenario)


def test_the_hand_drops_over_the_bin():
    scenario = load_scenario("clear_table", overrides=["clutter.count=1"])
    planner = MakeClearingPlanner(scenario)
    motions = planner.planner.motions
    X_WG = motions.scene.X_WG(motions.q_over)
    p_W = X_WG.translation()
    low, high = bin_boxes(scenario)["bin"]
    long = int(np.argmax((high - low)[:2]))  # loads lie across the closing direction
    assert abs(X_WG.rotation().matrix()[long, 2]) > 0.99
    assert p_W[:2] == pytest.approx(0.5 * (low + high)[:2], abs=1e-3)
    assert p_W[2] > high[2] + 0.2


def place_of(name, *p_W):
    return f"directives.{name}.add_weld.X_PC.translation={list(p_W)}"


def test_each_arm_has_the_bin_and_the_cameras_on_its_side():
    shares = shares_of(load_scenario("clear_table_together"))
    for name, (share, side) in shares.items():
        assert list(share.arms) == [name]
        assert list(share.task.place.bins) == [f"{name}_bin"]
        assert share.task.place.cameras == [f"{name}_bin"]
        assert share.localizer.cameras == [f"{name}_ceiling"]
        assert side.inward[1] == (1.0 if name == "left" else -1.0)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            place_of("left_bin::bottom", 0.34, -0.3, 0.0),
            r"task\.place\.bins: must have one bin on the side of arm 'left', got none",
        ),
        (
            place_of("right_bin::bottom", 0.34, 0.5, 0.0),
            r"task\.place\.bins: must .* 'left', got left_bin, right_bin",
        ),
        (
            place_of("left_bin::bottom", 0.34, 0.35, 0.0),
            r"task\.place\.bins\.left_bin: 'left_bin' must be at least 0\.21 m from",
        ),
        (
            "localizer.cameras=[right_ceiling]",
            r"localizer\.cameras: must have one .* of arm 'left', got right_ceiling",
        ),
        (
            "arms.left.arm.home=[-1.57, 0.9, 0.0, -0.6, 0.0, 1.5, 0.0]",
            r"arms\.left\.arm\.home: must be free, and on the arm's own side, got: ",
        ),
        (
            place_of("left::link_0", 0.0, 0.1, 0.0),
            r"arms\.left\.arm\.home: must be free, and on the arm's own side, got: ",
        ),
    ],
)
def test_what_two_arms_cannot_share_is_told(override, message):
    scenario = load_scenario("clear_table_together", overrides=[override])
    with pytest.raises(ScenarioError, match=f"^{message}"):
        MakeClearingPair(scenario)


@pytest.mark.parametrize(
    "base", ["clear_table_together", "clear_table_together_varied"]
)
def test_one_arm_alone_has_the_same_objects_and_nobody_to_wait_for(base, tmp_path):
    file = Path(__file__).parents[2] / "experiments/clear_table_alone.yaml"
    text = file.read_text("utf-8").replace("clear_table_together", base)
    (tmp_path / "alone.yaml").write_text(text, "utf-8")
    alone = load_scenario(tmp_path / "alone.yaml", seed=1000)
    assert alone.objects == load_scenario(base, seed=1000).objects
    planners = MakeClearingPair(alone)
    assert type(planners.GetSubsystemByName("left")) is ClearingPlanner
    assert planners.HasOutputPort("left.position_commanded")


def test_the_varied_cell_draws_as_that_of_one_arm():
    both = load_tree("clear_table_together_varied")
    alone = load_tree("clear_table_varied")
    assert both["clutter"]["kinds"] == alone["clutter"]["kinds"]
    assert both["task"]["spacing"] == alone["task"]["spacing"]
    lights = [
        tree["cameras"][name]["renderer_class"]["lights"]
        for tree, name in ((both, "left_ceiling"), (alone, "ceiling"))
    ]
    assert lights[0] == lights[1]
    assert set(both["camera_errors"]) == {
        *both["localizer"]["cameras"],
        *both["task"]["place"]["cameras"],
    }
    for errors in both["camera_errors"].values():
        assert errors == alone["camera_errors"]["ceiling"]
    for arm in both["arms"].values():
        for drive in ("arm", "gripper"):
            for key in ("motor_strength", "errors"):
                assert arm[drive][key] == alone[drive][key]
