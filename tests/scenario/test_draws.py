import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario.draws import draw_distributions, key_generator
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
