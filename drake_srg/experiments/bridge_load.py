"""Pace and delays of a served station under 1 kHz of commands, over ROS 1 and ROS 2.

A client in this process commands a kitchen that `drake-srg serve` runs in another
process, on all four topics of the thesis at once. Its commands change from time to
time. The delay is the time from a change until the station publishes that its drivers
follow it.
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import time as wall
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.experiments.bridge_client import (
    WIRES,
    Client,
    ServedProcess,
    ServeReport,
    open_wire,
    wait_for,
    watch,
)
from drake_srg.experiments.bridge_delays import measure_delays
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.robot.serve.commands import CommandInbox, Warnings
from drake_srg.robot.serve.loop import control_period
from drake_srg.robot.serve.pictures import COLOR, camera_topics, served_camera
from drake_srg.scenario import load_scenario
from drake_srg.types import Vector

_NAME = "bridge_load"
SCENARIO = "kitchen"
# Messages on each topic [Hz]. The station reads commands every 5 ms; 27 Hz is not in
# step with that, so the slow commands arrive at all times in between.
LOADS = {"1 kHz": 1000.0, "27 Hz": 27.0}
PACE_TOLERANCE = 0.01  # of simulated against real time, relative
# Allowed delay beyond a control period, for the wires and the processes.
SLACK = 0.005  # s
# A delay is a wait for the next control period plus scheduling, so it does not scale
# with the machine's speed. From run to run, it may move by SLACK; the longest, a single
# event, by the limit of all but 1 % of the delays.
IMAGE_COST = 0.003  # allowed time to send an image of 640 x 480 pixels [s]
# Scenarios whose full speed is measured.
FREE = ("kitchen", "kitchen_tendon", "kitchen_fast", "assistive_arm", "gripper_bench")


@dc.dataclass(frozen=True)
class Case:
    """A station under load or, without a wire, at full speed and without commands."""

    wire: str
    load: str = ""
    scenario: str = SCENARIO

    def __str__(self) -> str:
        return f"{self.wire}, {self.load}" if self.wire else f"{self.scenario}, free"


@dc.dataclass(frozen=True)
class Loaded:
    """The result of a load.

    Attributes:
        sent: Number of messages sent.
        times: Times at which a command changed, counted from the first message, shape
            (K,) [s].
        delays: Time until the station followed each change, shape (K,) [s]; NaN if it
            did not.
        last: Largest difference between the last commands and the final commands to the
            station's drivers [rad, 1].
        served: The station's report.
    """

    sent: int
    times: Vector
    delays: Vector
    last: float
    served: ServeReport


def run(
    track: Track,
    *,
    duration: float = 60.0,
    free_duration: float = 8.0,
    images: int = 100,
) -> ExperimentResult:
    """Load the station over each wire, and run the scenarios at full speed.

    Args:
        track: Shows the progress.
        duration: Duration of each load [s].
        free_duration: Duration of each run at full speed [s].
        images: Number of images to send over each wire.
    """
    loads = [Case(wire, load) for wire in WIRES for load in LOADS]
    free = [Case("", scenario=scenario) for scenario in FREE]
    loaded: dict[Case, Loaded] = {}
    served: dict[Case, ServeReport] = {}
    for case in track([*loads, *free]):
        if case.wire:
            loaded[case] = load_station(case.wire, LOADS[case.load], duration)
        else:
            served[case] = run_free(case.scenario, free_duration)
    costs = {wire: image_costs(wire, images) for wire in WIRES}
    period = control_period(load_scenario(SCENARIO))
    rows = [row for case in loaded for row in load_rows(case, loaded[case], period)]
    rows += [
        Row.at_most(
            f"{wire}, image",
            "time to send, median",
            1e3 * IMAGE_COST,
            1e3 * float(np.median(cost)),
            "ms",
            clock="time",
        )
        for wire, cost in costs.items()
    ]
    rows += [
        Row.info(
            case.scenario,
            "largest real-time factor",
            one.sim_time / one.wall_time,
            "",
            clock="rate",
        )
        for case, one in served.items()
    ]
    table: dict[str, npt.ArrayLike] = {
        "case": [str(case) for case, one in loaded.items() for _ in one.times],
        "time_s": np.concatenate([one.times for one in loaded.values()]),
        "delay_s": np.concatenate([one.delays for one in loaded.values()]),
    }
    return ExperimentResult(rows, {"delays": table}, draw(loaded, period))


def load_rows(case: Case, loaded: Loaded, period: float) -> list[Row]:
    """Return the result rows of a load, for a station with a control period [s]."""
    name, served = str(case), loaded.served
    quarter = max(len(loaded.delays) // 4, 1)
    first, last = loaded.delays[:quarter], loaded.delays[-quarter:]
    pace = served.sim_time / served.seen_time
    limit, slack = 1e3 * (period + SLACK), 1e3 * SLACK
    median, longest = 1e3 * float(np.median(loaded.delays)), 1e3 * loaded.delays.max()
    return [
        Row.within(name, "pace", 1.0, pace, "", absolute=PACE_TOLERANCE),
        Row.info(name, "messages", loaded.sent / served.wall_time, "1/s"),
        Row.within(name, "messages received", loaded.sent, served.commands, ""),
        Row.within(name, "deviation from the last commands", 0.0, loaded.last, ""),
        Row.info(name, "delay, median", median, "ms", spread=slack),
        Row.at_most(
            name,
            "delay, 99th percentile",
            limit,
            1e3 * float(np.percentile(loaded.delays, 99)),
            "ms",
            spread=slack,
        ),
        Row.info(name, "delay, longest", float(longest), "ms", spread=limit),
        Row.at_most(
            name,
            "delay, growth of the median",
            # Client and station may drift against each other, by at most one period.
            1e3 * period,
            1e3 * float(np.median(last) - np.median(first)),
            "ms",
            spread=1e3 * period,
        ),
    ]


def load_station(wire: str, rate: float, duration: float) -> Loaded:
    """Command a served station on all topics at `rate` [Hz] for `duration` [s]."""
    with open_wire(wire, _NAME) as opened:
        station = ServedProcess(SCENARIO, "--no-record", *opened.arguments)
        try:
            client = Client(opened.make_client)
            try:
                sent, times, delays, last = measure_delays(client, rate, duration)
            finally:
                client.close()
        finally:
            served = station.stop()
    return Loaded(sent, times, delays, last, served)


def run_free(scenario: str, duration: float) -> ServeReport:
    """Serve a scenario at full speed and without commands for a real duration [s]."""
    with open_wire("ROS 2", _NAME) as opened:
        arguments = ("--no-record", "--rate", "0", *opened.arguments)
        station = ServedProcess(scenario, *arguments)
        wall.sleep(duration)
        return station.stop()


def image_costs(wire: str, count: int) -> Vector:
    """Return the real time that a station needs to send each of `count` images [s]."""
    scenario = load_scenario(SCENARIO)
    camera = served_camera(scenario)
    assert camera is not None
    topic = camera_topics(*camera)[COLOR]
    pixels = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    costs = []
    with (
        open_wire(wire, _NAME) as opened,
        contextlib.closing(
            opened.make_station(CommandInbox([], Warnings(lambda text: None)), [topic])
        ) as bridge,
        watch(opened.make_client, topic.name, topic.type),
    ):
        wait_for(lambda: bridge.has_subscribers(COLOR))
        for i in range(count):
            wall.sleep(0.03)
            start = wall.perf_counter()
            bridge.publish(topic, 0.1 * i, [pixels])
            costs.append(wall.perf_counter() - start)
    return np.array(costs)


def draw(loaded: dict[Case, Loaded], period: float) -> Any:
    """Plot the delays over time, one panel per wire."""
    figure = make_figure(9.0, 2.6 * len(WIRES))
    axes = figure.subplots(len(WIRES), 1, sharex=True, sharey=True)
    for ax, wire in zip(axes, WIRES, strict=True):
        for case, one in loaded.items():
            if case.wire == wire:
                ax.plot(one.times, 1e3 * one.delays, ".", ms=3, label=case.load)
        ax.axhline(1e3 * (period + SLACK), color="0.5", lw=0.8)
        style_axes(ax, xlabel="time [s]", ylabel="delay [ms]")
        ax.set_title(wire, loc="left", fontsize=9)
        ax.legend(loc="upper right", fontsize=8)
    return figure
