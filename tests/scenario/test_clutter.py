import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import draw_scenario, load_scenario, load_tree

BOX = {
    "shape": {"_tag": "!Box", "size": [0.02, 0.02, 0.02]},
    "mass": {"_tag": "!Uniform", "min": 0.1, "max": 0.2},
    "friction": 0.5,
}
BALL = {"shape": {"_tag": "!Sphere", "radius": 0.02}, "mass": 0.1, "friction": 0.5}
BOXES, BOTH = {"box": BOX}, {"box": BOX, "ball": BALL}
SOME = {"_tag": "!UniformDiscrete", "values": [0, 1, 2, 3]}


def kitchen(clutter):
    tree = load_tree("kitchen")
    tree["task"] = {**tree["task"], "spacing": 0.1}
    return {**tree, "clutter": clutter}


@pytest.mark.slow
@given(st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_clutter_is_drawn_from_separate_streams_and_stands_clear(seed):
    drawn = draw_scenario(kitchen({"count": SOME, "kinds": BOTH}), "k", seed)
    objects = drawn.scenario.objects
    names = [name for name in objects if name.startswith("clutter_")]
    assert names == [f"clutter_{i + 1}" for i in range(drawn.scenario.clutter.count)]
    assert drawn.values["clutter.count"] == len(names)
    positions = [np.array(o.position) for o in objects.values()]
    for i, p in enumerate(positions):
        assert all(np.linalg.norm(p - q) > 0.1 for q in positions[:i])
    for name in names:
        assert not objects[name].known
        assert drawn.values[f"objects.{name}.position[0]"] == objects[name].position[0]
        kind = type(objects[name].shape).__name__
        assert drawn.values[f"objects.{name}.kind"] == {"Box": "box"}.get(kind, "ball")
    masses = [objects[name].mass for name in names if objects[name].mass != 0.1]
    assert len(set(masses)) == len(masses)


def test_all_kinds_appear():
    kinds = set()
    for seed in range(12):
        scenario = draw_scenario(kitchen({"count": 2, "kinds": BOTH}), "k", seed)
        kinds |= {type(o.shape).__name__ for o in scenario.scenario.objects.values()}
    assert {"Box", "Sphere"} <= kinds


def test_the_picked_object_stands_where_it_stood_without_clutter():
    plain = load_scenario("kitchen", seed=5)
    cluttered = draw_scenario(kitchen({"count": 3, "kinds": BOXES}), "k", 5).scenario
    assert cluttered.objects["soup_can"] == plain.objects["soup_can"]


def test_a_draw_does_not_change_the_tree():
    tree = kitchen({"count": SOME, "kinds": BOTH})
    first = draw_scenario(tree, "k", 1).values
    draw_scenario(tree, "k", 2)
    assert draw_scenario(tree, "k", 1).values == first


@pytest.mark.parametrize(
    ("clutter", "message"),
    [
        ({"count": 2}, "k: clutter.kinds: needs at least one kind, got none"),
        (
            {"count": -1, "kinds": BOXES},
            "k: clutter.count: must be 0 .. 100, got -1",
        ),
        ({"count": 1e9, "kinds": BOXES}, "k: clutter.count: must be 0 .. 100"),
        (
            {"count": 0.5, "kinds": BOXES},
            "k: clutter.count: must be a whole number",
        ),
        (
            {"count": 1, "kinds": {"x": {"shap": 1}}},
            "k: objects.clutter_1: unknown key 'shap' (",
        ),
        ({"count": 1, "kinds": 3}, "k: clutter.kinds: must be a mapping"),
        (3, "k: clutter: must be a mapping"),
        (
            {"count": 90, "kinds": {"ball": BALL}},
            "k: task.region: must be larger, no free place",
        ),
    ],
)
def test_errors_name_the_key(clutter, message):
    with pytest.raises(ScenarioError) as error:
        draw_scenario(kitchen(clutter), "k", 0)
    assert str(error.value).startswith(message)


def test_the_names_of_clutter_are_reserved():
    tree = kitchen({"count": 1, "kinds": BOXES})
    tree["objects"] = {**tree["objects"], "clutter_1": BALL}
    with pytest.raises(
        ScenarioError, match=r"objects\.clutter_1: this name is reserved"
    ):
        draw_scenario(tree, "k", 0)


def test_first_places_that_leave_no_room_are_drawn_again():
    # Two fit into the strip only near its ends, which are 0.35 m apart.
    tree = kitchen({"count": 1, "kinds": BOXES})
    tree["task"] = {
        **tree["task"],
        "spacing": 0.3,
        "region": {"min": [0.45, 0.0], "max": [0.8, 0.0]},
    }
    tree["objects"] = {"soup_can": {**tree["objects"]["soup_can"], "pose": None}}
    tree["objects"]["soup_can"]["position"] = [1.2, 0.6]
    tree["clutter"]["count"] = 2
    for seed in range(10):
        objects = draw_scenario(tree, "k", seed).scenario.objects
        first, second = (objects[f"clutter_{i}"].position[0] for i in (1, 2))
        assert abs(first - second) > 0.3
