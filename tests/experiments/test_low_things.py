import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments import low_things
from drake_srg.experiments.grasp_width_cases import Grasp
from drake_srg.experiments.low_things import (
    CURLED,
    HALF,
    HANDS,
    STRAIGHT,
    WIRES,
    judge,
    lying_bottle,
)
from drake_srg.experiments.registry import quiet
from drake_srg.simulation.rig import Rig, bench_scenario

HELD = Grasp(
    free=True,
    raised=0.08,
    slip=1e-4,
    closed=np.array([1.0, 0.5]),
    lifted=np.array([1.0, 0.5]),
    top=(0.085, 0.105),
)
LOST = dc.replace(HELD, free=False)
OFFSETS = (-0.02, 0.0, 0.02)


def rows(**lost):
    """Judge hands of which some lose the bottle everywhere."""
    names = {"straight": STRAIGHT, "curled": CURLED, "half": HALF, "wires": WIRES}
    losers = {names[key] for key in lost}
    return judge(
        {(h, x): LOST if h in losers else HELD for h in HANDS for x in OFFSETS}
    )


@pytest.mark.parametrize(
    ("lost", "failed"),
    [
        ({}, []),
        ({"straight": True, "wires": True}, []),
        ({"curled": True}, [CURLED]),
        ({"half": True}, [HALF]),
    ],
)
def test_tips_that_curl_must_hold_the_bottle(lost, failed):
    found = rows(**lost)
    assert [row.name for row in found if not row.passed] == failed
    leans = [row for row in found if row.unit == "deg"]
    assert leans[0].measured == pytest.approx(np.rad2deg(0.5 * np.pi - 1.5))


@pytest.mark.parametrize("hand", [STRAIGHT, WIRES])
def test_the_bottle_lies_below_the_hand_as_far_from_it_as_asked(hand):
    thing = lying_bottle(hand, 0.02)
    scenario = bench_scenario(
        thing.config, home=[0.0, 0.0, thing.z], overrides=thing.overrides
    )
    with Rig(scenario, name="low_things") as rig:
        X_GO = rig.X_GO()
    middle = X_GO.multiply(np.array([0.0, 0.0, low_things._MIDDLE]))
    # The hand's z is along the bottle, its y across.
    np.testing.assert_allclose(
        np.abs(X_GO.rotation().matrix()[:, 2]), [0, 0, 1], atol=1e-9
    )
    np.testing.assert_allclose(
        np.abs(X_GO.rotation().matrix()[:, 0]), [0, 1, 0], atol=1e-9
    )
    assert middle[1] == pytest.approx(0.0, abs=1e-6)
    along = X_GO.rotation().matrix()[2, 2] * middle[2]
    assert along == pytest.approx(-0.02, abs=1e-6)


@pytest.mark.slow
def test_curled_tips_hold_what_straight_ones_lose(monkeypatch):
    two = {hand: HANDS[hand] for hand in (STRAIGHT, CURLED)}
    monkeypatch.setattr(low_things, "HANDS", two)
    table = low_things.run(quiet, offsets=[0.02]).tables["grasps"]
    assert table["held"] == [0, 1]
    straight, curled = table["tip, closed [rad]"]
    assert straight == pytest.approx(0.0, abs=0.02) and curled > 0.3
