import dataclasses as dc
import json

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from drake_srg.vision.config import LocalizerThresholds


def thresholds(value):
    """Return the thresholds of a scenario that sets them."""
    overrides = [f"localizer.thresholds={value}"]
    return load_scenario("kitchen", overrides=overrides).localizer.thresholds


def test_every_default_is_within_its_bounds():
    defaults = LocalizerThresholds()
    assert thresholds(json.dumps(dc.asdict(defaults))) == defaults


def test_a_scenario_sets_single_thresholds():
    expected = LocalizerThresholds()
    expected.fit.noisy_guesses = 6
    expected.misfit_margin = 0.1
    assert thresholds("{fit: {noisy_guesses: 6}, misfit_margin: 0.1}") == expected


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("{sight: {edge_on: 2.0}}", r"sight\.edge_on: must be at most 1\.0"),
        ("{fit: {fine_softness: []}}", r"fit\.fine_softness: must not be empty"),
        ("{obstacles: {top: -1}}", r"obstacles\.top: must be at least 0\.0"),
        ("{leveling: {rounds: 0}}", r"leveling\.rounds: must be at least 1"),
        ("{fit: {apartt: 1}}", r"fit: unknown key 'apartt' \(did you mean 'apart'"),
    ],
)
def test_bad_thresholds_are_refused(value, message):
    with pytest.raises(ScenarioError, match=r"localizer\.thresholds\." + message):
        thresholds(value)
