"""The environments' errors for invalid keywords and scenes."""

import gymnasium
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.envs.scenes import Physics

MUG = "{model: package://drake_srg/sdf/mug.sdf}"


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"physics": "fats"}, "physics: unknown 'fats' (did you mean 'fast'? allowed:"),
        ({"driver": "plan"}, "driver: unknown 'plan' (did you mean 'plant'?"),
        ({"observation": "pixels"}, "observation: unknown 'pixels' (allowed:"),
        (
            {"reward": "dense"},
            "reward: unknown 'dense' (allowed: epsilon_forces, epsilon_patches, ",
        ),
        ({"nois": 0.1}, "unknown keyword 'nois' (did you mean 'noise'?"),
        ({"noise": -1.0}, "noise: must be at least 0 m, got -1.0"),
        ({"noise": "a"}, "noise: must be at least 0 m, got 'a'"),
        ({"scenario": "nowhere"}, "unknown scenario 'nowhere'"),
        ({"scenario": "clear_table"}, "clear_table: task.pick: must name the only"),
        ({"overrides": ["arm.hom=1"]}, "learn_bench: arm: unknown key 'hom'"),
        ({"overrides": "table.height=1"}, "overrides: must be a list of KEY=VALUE"),
        (
            {"overrides": ["plant_config.time_step=0.001"]},
            "overrides: plant_config.time_step: cannot be set with physics=train",
        ),
        (
            {"overrides": ["gripper=!SrgTendonDriver {}"]},
            "overrides: gripper: cannot be set with physics=train and driver=plant",
        ),
        (
            {"overrides": [f"clutter.kinds.mug={MUG}"]},
            "learn_bench: clutter.kinds: an environment is built once",
        ),
    ],
)
def test_a_wrong_keyword_is_one_clear_line(keywords, message):
    with pytest.raises(ScenarioError) as error:
        gymnasium.make("drake_srg/Pick-v0", **keywords)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def test_an_override_may_name_a_model_by_a_relative_path():
    """Made absolute, it looked like one that had no effect."""
    tree = Physics().scenario_tree("learn_bench", ["clutter.kinds.box.model=my.sdf"])
    assert tree["clutter"]["kinds"]["box"]["model"].endswith("/my.sdf")


def test_a_reward_that_judges_a_lift_needs_one():
    with pytest.raises(ScenarioError, match=r"^reward: unknown 'slip_margin' .*shaped"):
        gymnasium.make("drake_srg/KitchenPickPlace-v0", reward="slip_margin")


BALL = {"_tag": "!Sphere", "radius": 0.03}
THING = {"shape": BALL, "position": [0.5, 0.0]}


def scene_with(**changes):
    return {"scene": {"object": THING} | changes}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scen": {}}, "options: unknown key 'scen'"),
        (3, "options: must be a mapping, got int"),
        ({"scene": 3}, "scene: must be a mapping"),
        (scene_with(estimate_error=["a", "b"]), "scene: estimate_error: must be two"),
        (scene_with(object={"position": [0.5, 0.0]}), "scene: object: needs a shape"),
        ({"scene": {"objekt": {}}}, "scene: unknown key 'objekt'"),
        ({"scene": {"object": {"mass": 1.0}}}, "scene: object.position: must be given"),
        (scene_with(), "scene: object.mass: must be given with a shape"),
        (scene_with(object={**THING, "mass": 1.0}), "scene: object.friction: must be"),
        (
            scene_with(object={"model": "x.sdf", "position": [0.5, 0.0]}),
            "scene: object.model: must be empty, as the environment was built, got",
        ),
    ],
)
def test_a_wrong_scene_is_one_clear_line(pick, options, message):
    with pytest.raises(ScenarioError) as error:
        pick.reset(options=options)
    assert str(error.value).startswith(message)


@pytest.mark.parametrize("name", ["GraspOneShot-v0", "Pick-v0"])
def test_a_step_before_the_first_reset_is_gymnasiums_own_error(name):
    env = gymnasium.make(f"drake_srg/{name}")
    action = env.action_space.sample()
    for asked in (env, env.unwrapped):
        with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
            asked.step(action)
