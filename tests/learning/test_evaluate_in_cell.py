import dataclasses as dc

import pytest
from sweeps.stub import StubEngine

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import EVALUATION
from drake_srg.learning.evaluate_in_cell import ONE_SHOT, cell_policy, evaluate_in_cell
from drake_srg.learning.policy import load_policy
from drake_srg.learning.rules import pick_by_touch

from .made_policies import made_policy

PLANT = "gripper=!PlantServoDriver {}"


def run(policy, scenario, out, *overrides, trials=1, **options):
    return evaluate_in_cell(
        str(policy),
        scenario,
        trials,
        out=out,
        engine=StubEngine(),
        overrides=overrides,
        **options,
    )


@pytest.mark.slow
def test_the_packages_policy_holds_a_can_in_the_kitchen(tmp_path):
    rows = run("grasp_one_shot", "kitchen_fast", tmp_path, PLANT).to_pylist()
    assert [row["success"] for row in rows] == [True]
    assert rows[0]["failure"] is None
    assert rows[0]["placement_error_m"] is None
    assert rows[0]["seed"] == EVALUATION
    assert max(map(abs, rows[0]["localization_error_m"])) < 2e-3
    with pytest.raises(ScenarioError, match=r"soup_can\.mass.* was"):
        override = "objects.soup_can.mass=0.3"
        run("grasp_one_shot", "kitchen_fast", tmp_path, PLANT, override, resume=True)


@pytest.mark.parametrize(
    ("scenario", "overrides", "message"),
    [
        ("kitchen_fast", [], r"driver=plant, kitchen_fast has !SrgPositionDriver "),
        ("assistive_arm_fast", [], "gripper: policies grasp with an SRG"),
        ("gripper_bench_fast", [PLANT], "also needs localizer.cameras"),
        ("clear_table_fast", [PLANT], "also needs task.pick"),
        ("nowhere.yaml", [], "No such file"),
    ],
)
def test_a_cell_that_does_not_fit_is_one_line(tmp_path, scenario, overrides, message):
    with pytest.raises(ScenarioError, match=message) as error:
        run("grasp_one_shot", scenario, tmp_path / "out", *overrides)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_policy_that_moves_the_hand_holds_a_can_in_the_kitchen(tmp_path):
    rows = run("pick", "kitchen_fast", tmp_path / "policy", PLANT).to_pylist()
    assert [row["success"] for row in rows] == [True]
    # So does its rule; random actions do not.
    for name, failure in (("rule", None), ("random", "no_grasp")):
        out = tmp_path / name
        kind = {"environment": "Pick"}
        rows = run(name, "kitchen_fast", out, PLANT, **kind).to_pylist()
        assert [(row["success"], row["failure"]) for row in rows] == [
            (failure is None, failure)
        ]
    # The rule of another environment is another sweep.
    with pytest.raises(ScenarioError, match=r"environment.* was"):
        run("rule", "kitchen_fast", tmp_path / "rule", PLANT, resume=True)


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ("drake_srg/KitchenPickPlace-v0", f"takes policies for {ONE_SHOT}, "),
        ("drake_srg/Pick-v0", "has 2 observations, drake_srg/Pick-v0 needs 25"),
    ],
)
def test_policies_of_other_environments_are_refused(tmp_path, environment, message):
    policy = made_policy(environment=environment)
    policy.save(tmp_path / "policy.npz")
    with pytest.raises(ScenarioError, match=message):
        run(tmp_path / "policy.npz", "kitchen_fast", tmp_path / "out", PLANT)


def test_a_policy_that_was_trained_blind_stays_blind(tmp_path):
    assert cell_policy("pick", ONE_SHOT, EVALUATION).touch
    policy = load_policy("pick")
    info = dc.replace(policy.info, keywords={"touch": False})
    dc.replace(policy, info=info).save(tmp_path / "policy.npz")
    assert not cell_policy(str(tmp_path / "policy.npz"), ONE_SHOT, EVALUATION).touch


def test_a_rule_acts_as_in_an_environment_that_has_it():
    found = cell_policy("touch", ONE_SHOT, EVALUATION)
    assert found.environment == "drake_srg/Pick-v0"
    assert found.act is pick_by_touch


@pytest.mark.parametrize(
    ("override", "changes", "message"),
    [
        (
            "arm.home=[0.0, -0.3, 0.0, -1.9, 0.0, 0.5, 0.0]",
            {"environment": ONE_SHOT},
            "must point down",
        ),
        (
            "task.region={min: [1.5, -0.1], max: [1.7, 0.1]}",
            {"environment": "Pick"},
            "does not reach|region",
        ),
        ("random_seed=0", {"seed": 3}, "training uses lower seeds"),
    ],
)
def test_what_a_baseline_cannot_do_is_told(tmp_path, override, changes, message):
    with pytest.raises(ScenarioError, match=message):
        run("rule", "kitchen_fast", tmp_path / "out", PLANT, override, **changes)
