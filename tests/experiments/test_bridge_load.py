from types import SimpleNamespace

import numpy as np
import pytest
from helpers import needs_debian

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments import bridge_load
from drake_srg.experiments.bridge_client import Served, ServedProcess
from drake_srg.experiments.bridge_load import Case, Loaded, draw, load_rows

CASE = Case("ROS 2", "1 kHz")


def loaded(
    delays=(0.004, 0.006, 0.005), sim_time=60.0, commands=1000, last=0.0, sent=1000
):
    served = Served(sim_time, 60.0, 60.0, commands, "")
    return Loaded(sent, np.arange(len(delays)), np.array(delays), last, served)


def failed(one):
    return [row.quantity for row in load_rows(CASE, one, 0.005) if not row.passed]


def test_a_station_that_keeps_time_passes():
    assert failed(loaded()) == []


@pytest.mark.parametrize(
    "fault, quantities",
    [
        ({"sim_time": 59.0}, ["pace"]),
        ({"sim_time": 61.0}, ["pace"]),
        ({"commands": 999}, ["messages that came"]),
        ({"last": 0.01}, ["last commands, deviation"]),
        ({"delays": [0.012] * 30}, ["delay, 99 of 100"]),
        (
            {"delays": np.linspace(0.001, 0.009, 30)},
            ["delay, growth of the median"],
        ),
        (
            {"delays": [0.004, np.nan]},
            [
                *("delay, median", "delay, 99 of 100", "delay, longest"),
                "delay, growth of the median",
            ],
        ),
    ],
)
def test_what_does_not_is_found(fault, quantities):
    assert failed(loaded(**fault)) == quantities


def test_delays_are_from_a_change_to_when_its_joint_leaves_its_rest():
    heard = [(0.0, 0.0), (0.0, 0.0), (1e-7, 0.0), (0.01, 0.0), (0.01, 0.5)]
    client = SimpleNamespace(
        arm=[(10.0 + 0.1 * i, np.array(q)) for i, q in enumerate(heard)]
    )
    changes = [(10.15, 0, 0.0), (10.25, 1, 0.0), (10.35, 0, 0.01)]
    delays = bridge_load._delays(client, changes)
    np.testing.assert_allclose(delays, [0.05, 0.15, np.nan])


@pytest.mark.parametrize("wire", bridge_load.WIRES)
def test_a_short_load_of_a_real_station(wire):
    if wire == "ROS 1":
        needs_debian("roscore")
    one = bridge_load.load_station(wire, rate=50.0, duration=2.0)
    assert one.sent == one.served.commands == 400
    assert one.last == 0.0
    # A busy machine may be too slow; nothing else may be wrong.
    warnings = one.served.warnings.splitlines()
    assert [line for line in warnings if "cannot keep" not in line] == []
    assert len(one.delays) >= 5 and np.isfinite(one.delays).all()


def test_the_cost_of_images_is_that_of_all(monkeypatch):
    monkeypatch.setattr(bridge_load, "IMAGES", 5)
    costs = bridge_load.image_costs("ROS 2")
    assert costs.shape == (5,) and (costs > 0.0).all()


def test_a_station_that_cannot_be_served_says_why():
    with pytest.raises(ScenarioError, match="!SrgTendonDriver"):
        ServedProcess("kitchen", "--no-record", "--servo", "pty")


def test_the_figure_shows_both_wires():
    cases = {Case(wire, "1 kHz"): loaded() for wire in bridge_load.WIRES}
    titles = [axes.get_title(loc="left") for axes in draw(cases, 0.005).axes]
    assert titles == list(bridge_load.WIRES)
