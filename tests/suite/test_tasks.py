import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import EVALUATION
from drake_srg.scenario.load import draw_scenario, load_tree
from drake_srg.suite.tasks import (
    EPISODES,
    GOALS,
    SPLITS,
    find_tasks,
    load_tasks,
    scenario_seed,
)

TASKS = load_tasks()
NUMBERS = st.integers(0, EVALUATION - 1)


def test_there_are_at_least_twelve_tasks_and_every_goal_has_one():
    assert len(TASKS) >= 12
    assert {task.goal for task in TASKS.values()} == set(GOALS)


@pytest.mark.parametrize("name", TASKS)
def test_a_task_is_told_in_three_sentences_of_its_own(name):
    wordings = TASKS[name].wordings
    assert len(set(wordings)) == 3
    assert all(re.fullmatch(r"[A-Z].{10,100}\.", text) for text in wordings)
    others = [w for n, task in TASKS.items() if n != name for w in task.wordings]
    assert not set(wordings) & set(others)
    assert TASKS[name].varied


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("name", TASKS)
def test_a_task_draws_different_episodes_of_a_valid_scenario(name, split):
    task = TASKS[name]
    tree = load_tree(task.scenario, task.set)
    first, again, second = (
        draw_scenario(tree, name, scenario_seed(split, i)) for i in (0, 0, 1)
    )
    assert first.values == again.values
    assert first.values != second.values
    assert bool(first.scenario.task.clear) == (task.goal == "clear")
    # One policy sees images of one size, and LeRobot makes videos of all.
    sizes = {"ceiling": (640, 480), "overview": (480, 270)}
    cameras = first.scenario.cameras
    assert {n: (cameras[n].width, cameras[n].height) for n in sizes} == sizes


@given(evaluated=st.integers(0, 10**12), trained=NUMBERS)
def test_no_training_has_an_episode_of_evaluation(evaluated, trained):
    seed = scenario_seed("evaluation", evaluated)
    assert EVALUATION <= seed < EVALUATION + EPISODES
    assert scenario_seed("training", trained) == trained < EVALUATION


def test_evaluation_begins_anew_after_its_last_episode():
    seeds = [scenario_seed("evaluation", i) for i in range(2 * EPISODES)]
    assert seeds[:EPISODES] == seeds[EPISODES:]
    assert len(set(seeds)) == EPISODES == 200


@pytest.mark.parametrize(
    ("split", "number", "message"),
    [
        ("evaluation", -1, "seed: must be at least 0, got -1"),
        ("training", EVALUATION, "seed: .* is out of range"),
    ],
)
def test_seeds_out_of_range_are_named(split, number, message):
    with pytest.raises(ScenarioError, match=message):
        scenario_seed(split, number)


def test_names_are_found_in_a_text_or_a_list():
    assert find_tasks("pick_can, place_can") == ["pick_can", "place_can"]
    assert find_tasks(["pick_can"]) == ["pick_can"]
    assert find_tasks("all") == list(TASKS)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("pick_cn", "task: unknown 'pick_cn'.*pick_can"),
        ("pick_can,pick_can", "task: 'pick_can' is repeated"),
        (" ,", r"task: must name a task \(allowed: pick_can"),
    ],
)
def test_wrong_names_are_one_line(names, message):
    with pytest.raises(ScenarioError, match=message) as raised:
        find_tasks(names)
    assert "\n" not in str(raised.value)
