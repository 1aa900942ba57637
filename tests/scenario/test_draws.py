import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario.draws import draw_choices, draw_distributions, key_generator
from drake_srg.scenario.typed_yaml import parse_yaml


def draw(text, seed=3, key="k"):
    return draw_distributions({key: parse_yaml(f"v: {text}", "f")["v"]}, seed, "f")[key]


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("!Uniform {min: 1, max: 2}", 1, 2),
        ("!Deterministic {value: 1.5}", 1.5, 1.5),
        ("!UniformDiscrete {values: [3, 4]}", 3, 4),
        ("!UniformVector {min: [1, 1], max: [2, 2]}", 1, 2),
        ("!DeterministicVector {value: [1, 2]}", 1, 2),
        ("!Gaussian {mean: 5, stddev: 0.1}", 4, 6),  # 10 standard deviations
        ("!GaussianVector {mean: [5, 5], stddev: [0.1, 0.1]}", 4, 6),
    ],
)
def test_every_distribution_is_drawn(text, low, high):
    drawn = np.array(draw(text))
    assert np.all((low <= drawn) & (drawn <= high))
    assert drawn.ndim == ("Vector" in text)


def test_a_draw_depends_on_seed_and_key_alone():
    text = "!Uniform {min: 0, max: 1}"
    assert draw(text) == draw(text)
    assert len({draw(text, seed, key) for seed in range(5) for key in "abcd"}) == 20
    nested = parse_yaml(f"a: {{b: {text}, c: {text}}}\nd: [1, {text}]", "f")
    first = draw_distributions(nested, 3, "f")
    del nested["a"]["c"]
    second = draw_distributions(nested, 3, "f")
    assert first["a"]["b"] == second["a"]["b"]
    assert first["d"] == second["d"]


def test_draws_are_spread_evenly():
    draws = [draw("!Uniform {min: 0, max: 1}", seed) for seed in range(400)]
    # The mean of 400 has a standard deviation of 0.0144; five of them.
    assert np.mean(draws) == pytest.approx(0.5, abs=0.072)


def test_huge_seeds_have_generators_of_their_own():
    assert key_generator(2**80, "k")() != key_generator(2**80 + 1, "k")()


@pytest.mark.parametrize(
    "text",
    [
        "!Uniform {min: 2, max: 1}",
        "!Uniform {min: 1}",
        "!Uniform {min: 1, max: 2, mean: 1}",
        "!Uniform {min: a, max: 2}",
        "!Uniform {min: .nan, max: 2}",
        "!Uniform {min: -.inf, max: .inf}",
        "!Uniform {min: [1], max: [2]}",
        "!UniformDiscrete {values: []}",
        "!UniformVector {min: [1], max: [1, 2]}",
        "!UniformVector {min: [2, 2], max: [3, 1]}",
        "!Gaussian {mean: 1, stddev: -1}",
    ],
)
def test_invalid_distributions_are_refused(text):
    with pytest.raises(ScenarioError, match=rf"^f: k: {text.split()[0]} needs finite"):
        draw(text)


CHOICES = """
size: 0
choices:
  fruit:
    apple: {size: 1, choices: {colour: {red: {hue: 0}, green: {hue: 120}}}}
    plum: {size: 2}
"""


def chosen(seed=0, **keys):
    values = {}
    tree = {**parse_yaml(CHOICES, "f"), **keys}
    return draw_choices(tree, seed, "f", values), values


def test_a_choice_is_laid_over_the_scenario():
    for seed in range(20):
        tree, values = chosen(seed)
        assert tree["size"] == {"apple": 1, "plum": 2}[values["choices.fruit"]]
        assert ("hue" in tree) == (values["choices.fruit"] == "apple")
        assert "choices" not in tree


def test_every_choice_comes_up():
    drawn = {tuple(chosen(seed)[1].values()) for seed in range(40)}
    assert drawn == {("apple", "red"), ("apple", "green"), ("plum",)}


def test_what_is_chosen_is_not_drawn():
    for seed in range(10):
        tree, values = chosen(seed, chosen={"fruit": "apple", "colour": "green"})
        assert (tree["size"], tree["hue"], values) == (1, 120, {})


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"chosen": {"fruit": "pear"}}, r"f: chosen\.fruit: got 'pear' .*apple, plum"),
        ({"choices": 3}, "f: choices: must be a mapping"),
        ({"choices": {"fruit": {}}}, r"f: choices\.fruit: must be a mapping"),
        ({"choices": {"fruit": {"plum": 1}}}, r"f: choices\.fruit\.plum: must be"),
    ],
)
def test_choices_that_are_none_are_refused(keys, message):
    with pytest.raises(ScenarioError, match=message):
        chosen(**keys)
