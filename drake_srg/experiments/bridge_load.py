"""How a served station keeps time under 1 kHz of commands, by ROS 1 and ROS 2.

A client in this process commands a kitchen that `drake-srg serve` runs in another one,
on all four topics of the thesis at once. What it commands changes now and then: how
long until the station, asked by topic, says that it does what it is told?
"""

from __future__ import annotations

import contextlib
import dataclasses as dc
import time as wall
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.bridges.commands import CommandInbox, Warnings
from drake_srg.bridges.pictures import served_camera
from drake_srg.bridges.serve import control_period
from drake_srg.bridges.topics import COLOR, camera_topics
from drake_srg.experiments.bridge_client import (
    WIRES,
    Client,
    Served,
    ServedProcess,
    meeting_place,
    wait_for,
    watcher,
)
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import make_figure, style_axes
from drake_srg.scenario import load_scenario
from drake_srg.types import Vector

SCENARIO = "kitchen"
DURATION = 60.0  # of each load [s]
# Messages on each topic [1/s]; the slow ones come at all times between the station's
# looks for commands, every 5 ms.
LOADS = {"1 kHz": 1000.0, "27 Hz": 27.0}
# Real time and what is simulated may differ by this share.
PACE_TOLERANCE = 0.01
# What a command may take beyond a control period, on the wires and in the processes.
SLACK = 0.005  # s
# A command of the arm moves one joint by this and lets it come to rest, so that it is
# seen when the next one moves it [rad, s].
STEP, REST = 0.01, 0.8
# What a joint is moved by that is not at rest: in a first period of 5 ms it is jerk
# times time cubed over 6, 3e-8 [rad].
_MOVED = 1e-9
# Images that are sent, of 640 x 480 pixels, and what one may cost who sends it [s].
IMAGES, IMAGE_COST = 100, 0.003
# How fast these run when nothing holds them back.
FREE = ("kitchen", "kitchen_tendon", "kitchen_fast", "assistive_arm", "gripper_bench")
FREE_DURATION = 8.0  # s


@dc.dataclass(frozen=True)
class Case:
    """A station under load, or (without a wire) left alone at full speed."""

    wire: str
    load: str = ""
    scenario: str = SCENARIO

    def __str__(self) -> str:
        return f"{self.wire}, {self.load}" if self.wire else f"{self.scenario}, free"


@dc.dataclass(frozen=True)
class Loaded:
    """What came of a load.

    Attributes:
        sent: Messages.
        times: When a command changed, from the first message on, shape (K,) [s].
        delays: How long until the station said so, shape (K,) [s]; NaN: it did not.
        last: Difference between the last commands and what the station then does, the
            largest of all numbers [rad, 1].
        served: What the station says.
    """

    sent: int
    times: Vector
    delays: Vector
    last: float
    served: Served


def run(track: Track) -> ExperimentResult:
    """Load the station by each wire, and let the scenarios run free."""
    loads = [Case(wire, load) for wire in WIRES for load in LOADS]
    free = [Case("", scenario=scenario) for scenario in FREE]
    loaded: dict[Case, Loaded] = {}
    served: dict[Case, Served] = {}
    for case in track([*loads, *free]):
        if case.wire:
            loaded[case] = load_station(case.wire, LOADS[case.load], DURATION)
        else:
            served[case] = run_free(case.scenario, FREE_DURATION)
    costs = {wire: image_costs(wire) for wire in WIRES}
    period = control_period(load_scenario(SCENARIO))
    rows = [row for case in loaded for row in load_rows(case, loaded[case], period)]
    rows += [
        Row.at_most(
            f"{wire}, image",
            "cost of sending, median",
            1e3 * IMAGE_COST,
            1e3 * float(np.median(cost)),
            "ms",
        )
        for wire, cost in costs.items()
    ]
    rows += [
        Row.info(
            case.scenario, "real-time factor, free", one.sim_time / one.wall_time, ""
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
    """Judge a load of a station that looks for commands every `period` [s]."""
    name, served = str(case), loaded.served
    quarter = max(len(loaded.delays) // 4, 1)
    first, last = loaded.delays[:quarter], loaded.delays[-quarter:]
    pace = served.sim_time / served.seen_time
    limit = 1e3 * (period + SLACK)
    return [
        Row.within(name, "pace", 1.0, pace, "", absolute=PACE_TOLERANCE),
        Row.info(name, "messages", loaded.sent / served.wall_time, "1/s"),
        Row.within(name, "messages that came", loaded.sent, served.commands, ""),
        Row.within(name, "last commands, deviation", 0.0, loaded.last, ""),
        Row.info(name, "delay, median", 1e3 * float(np.median(loaded.delays)), "ms"),
        Row.at_most(
            name,
            "delay, 99 of 100",
            limit,
            1e3 * float(np.percentile(loaded.delays, 99)),
            "ms",
        ),
        Row.info(name, "delay, longest", 1e3 * float(loaded.delays.max()), "ms"),
        Row.at_most(
            name,
            "delay, growth of the median",
            # How client and station are in step may change, by no more than a period.
            1e3 * period,
            1e3 * float(np.median(last) - np.median(first)),
            "ms",
        ),
    ]


def load_station(wire: str, rate: float, duration: float) -> Loaded:
    """Command a served station on all topics, `rate` messages a second on each."""
    with meeting_place(wire) as place:
        station = ServedProcess(SCENARIO, "--no-record", *place.arguments)
        try:
            client = Client(place.make_client)
            try:
                sent, times, delays, last = _command(client, rate, duration)
            finally:
                client.close()
        finally:
            served = station.stop()
    return Loaded(sent, times, delays, last, served)


def run_free(scenario: str, duration: float) -> Served:
    """Let a station run as fast as it can, for a real time [s]; nobody commands it."""
    with meeting_place("ROS 2") as place:
        arguments = ("--no-record", "--rate", "0", *place.arguments)
        station = ServedProcess(scenario, *arguments)
        wall.sleep(duration)
        return station.stop()


def image_costs(wire: str) -> Vector:
    """Time that it takes a station to send an image, once for each of `IMAGES` [s]."""
    scenario = load_scenario(SCENARIO)
    camera = served_camera(scenario)
    assert camera is not None
    topic = camera_topics(*camera)[COLOR]
    pixels = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    costs = []
    with (
        meeting_place(wire) as place,
        contextlib.closing(
            place.make_station(CommandInbox([], Warnings(lambda text: None)), [topic])
        ) as bridge,
        watcher(place.make_client, topic.name, topic.type),
    ):
        wait_for(lambda: bridge.has_subscribers(COLOR))
        for i in range(IMAGES):
            wall.sleep(0.03)
            start = wall.perf_counter()
            bridge.publish(topic, 0.1 * i, [pixels])
            costs.append(wall.perf_counter() - start)
    return np.array(costs)


def _command(
    client: Client, rate: float, duration: float
) -> tuple[int, Vector, Vector, float]:
    """Send commands; see `Loaded` for what comes of it."""
    home = client.arm[-1][1]
    target, closed = home.copy(), 0
    changes: list[tuple[float, int, float]] = []  # when, joint, where it rested
    n, start = len(home), wall.monotonic()
    sent, next_change = 0, start + 1.0
    random = np.random.default_rng(0)
    for step in range(round(duration * rate)):
        wall.sleep(max(start + step / rate - wall.monotonic(), 0.0))
        now = wall.monotonic()
        if now >= next_change:
            joint = len(changes) % n
            changes.append((now, joint, target[joint]))
            there_and_back = STEP if target[joint] == home[joint] else 0.0
            target[joint] = home[joint] + there_and_back
            # At all times between the station's looks for commands.
            next_change = now + REST / n * random.uniform(1.0, 1.2)
        closed = step % 101
        client.send(
            {
                "/position_grasp": [0.0] * 4,
                "/grasp": closed,
                "/startgrasp": True,
                "/kuka": target,
            }
        )
        sent += 4
    wall.sleep(2.0)  # for the arm to come to rest
    last = max(
        abs(client.closure[-1][1][0] - closed / 100.0),
        float(np.abs(client.arm[-1][1] - target).max()),
    )
    times = np.array([when for when, *_ in changes])
    return sent, times - start, _delays(client, changes), last


def _delays(client: Client, changes: list[tuple[float, int, float]]) -> Vector:
    """How long after each change its joint was first heard to leave its rest [s]."""
    heard_at = np.array([when for when, _ in client.arm])
    heard = np.array([position for _, position in client.arm])
    delays = []
    for when, joint, rest in changes:
        after = slice(int(np.searchsorted(heard_at, when)), None)
        moved = np.flatnonzero(np.abs(heard[after, joint] - rest) > _MOVED)
        delays.append(heard_at[after][moved[0]] - when if len(moved) else np.nan)
    return np.array(delays)


def draw(loaded: dict[Case, Loaded], period: float) -> Any:
    """Draw the delays over the time, a line of panels."""
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
