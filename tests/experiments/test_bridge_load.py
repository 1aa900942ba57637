import re

import numpy as np
import pytest
from helpers import needs_debian

from drake_srg.experiments.bridge_client import WIRES, ServeReport
from drake_srg.experiments.bridge_load import (
    Case,
    Loaded,
    draw,
    image_costs,
    load_rows,
    load_station,
)

CASE = Case("ROS 2", "1 kHz")


def loaded(
    delays=(0.004, 0.006, 0.005), sim_time=60.0, commands=1000, last=0.0, sent=1000
):
    served = ServeReport(sim_time, 60.0, 60.0, commands, "")
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
        ({"commands": 999}, ["messages received"]),
        ({"last": 0.01}, ["deviation from the last commands"]),
        ({"delays": [0.012] * 30}, ["delay, 99th percentile"]),
        (
            {"delays": np.linspace(0.001, 0.009, 30)},
            ["delay, growth of the median"],
        ),
        (
            {"delays": [0.004, np.nan]},
            [
                *("delay, median", "delay, 99th percentile", "delay, longest"),
                "delay, growth of the median",
            ],
        ),
    ],
)
def test_each_fault_fails_its_rows(fault, quantities):
    assert failed(loaded(**fault)) == quantities


@pytest.mark.slow
@pytest.mark.parametrize("wire", WIRES)
def test_a_real_station_follows_a_short_load(wire):
    if wire == "ROS 1":
        needs_debian("roscore")
    one = load_station(wire, rate=50.0, duration=2.0)
    assert one.sent == one.served.commands == 400
    assert one.last == 0.0
    # The only warnings allowed are those of a busy machine: it cannot keep the pace, or
    # roscore takes long to start.
    busy = re.compile("cannot keep|waiting for it")
    warnings = one.served.warnings.splitlines()
    assert [line for line in warnings if not busy.search(line)] == []
    assert len(one.delays) >= 5 and np.isfinite(one.delays).all()


@pytest.mark.slow
def test_every_image_has_a_cost():
    assert image_costs("ROS 2", 5).shape == (5,)


def test_the_figure_has_a_panel_per_wire():
    cases = {Case(wire, "1 kHz"): loaded() for wire in WIRES}
    titles = [axes.get_title(loc="left") for axes in draw(cases, 0.005).axes]
    assert titles == list(WIRES)
