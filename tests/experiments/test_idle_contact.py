import numpy as np
import pytest

from drake_srg.experiments import idle_contact
from drake_srg.experiments.idle_contact import SPEED_LIMIT, Case, Closed, judge
from drake_srg.experiments.registry import quiet

CASE = Case("SrgPositionDriver", "pointing down", 0.005)
TIME = np.arange(0.0, 2.0, 0.005)


def made_up(amplitude=0.0, force=10.0, ripple=0.0):
    """A hand whose third joint and contact force oscillate at 20 Hz."""
    swing = np.sin(2 * np.pi * 20.0 * TIME)
    speeds = np.zeros((len(TIME), 4))
    speeds[:, 2] = amplitude * swing
    return Closed(TIME, speeds, force + ripple * swing)


def failed(response):
    return [row.quantity for row in judge(CASE, response) if not row.passed]


@pytest.mark.parametrize(
    ("response", "words"),
    [
        (made_up(), []),
        (made_up(amplitude=0.9 * np.sqrt(2) * SPEED_LIMIT), []),
        (made_up(amplitude=1.1 * np.sqrt(2) * SPEED_LIMIT), ["speed"]),
        (made_up(ripple=0.04), []),
        (made_up(ripple=0.06), ["peak to peak"]),
        (made_up(force=0.4), ["mean"]),
    ],
)
def test_chatter_fails(response, words):
    found = failed(response)
    assert len(found) == len(words)
    for quantity, word in zip(found, words, strict=True):
        assert word in quantity


def test_only_the_last_second_counts():
    response = made_up()
    response.speeds[TIME < 0.9] = 1.0
    response.force[TIME < 0.9] = 0.0
    assert failed(response) == []


@pytest.mark.slow
@pytest.mark.parametrize("driver", idle_contact.DRIVERS)
def test_the_fingers_of_a_closed_hand_press_on_each_other_at_rest(driver, monkeypatch):
    monkeypatch.setattr(idle_contact, "DRIVERS", (driver,))
    monkeypatch.setattr(idle_contact, "HANDS", {"pointing down": (0, 90, 0)})
    result = idle_contact.run(quiet, time_steps=[0.005], duration=5.0)
    assert result.passed, result.table()
    (table,) = result.tables.values()
    assert table["time [s]"][-1] == pytest.approx(5.0)
    assert np.all(table["5 ms: smallest force [N]"] <= table["5 ms: largest force [N]"])
    assert len(result.figure.axes) == 2
