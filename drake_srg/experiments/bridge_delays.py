"""Command a served kitchen, and measure the delays until it follows."""

from __future__ import annotations

import dataclasses as dc
import time as wall
from collections.abc import Sequence

import numpy as np

from drake_srg.experiments.bridge_client import Client
from drake_srg.types import Vector

# A command moves one joint of the arm by STEP [rad], and no other command moves it for
# REST [s]. So it comes to rest, and its next motion shows the next command's effect.
STEP, REST = 0.01, 0.8
# A joint that has moved by more is not at rest [rad]. In the first period of 5 ms it
# moves by jerk x time^3 / 6 = 3e-8 rad.
_MOVED = 1e-9
# How long to wait for the station to reach the last commands [s, real].
_SETTLING = 20.0


@dc.dataclass(frozen=True)
class Change:
    """A change of the commanded arm position.

    Attributes:
        time: Real time [s].
        joint: Index of the joint that moves.
        rest: Position of the joint before [rad].
    """

    time: float
    joint: int
    rest: float


def measure_delays(
    client: Client, rate: float, duration: float
) -> tuple[int, Vector, Vector, float]:
    """Command a served kitchen on all topics, and measure how soon it follows.

    Args:
        client: Is connected to the station.
        rate: Messages on each topic [Hz].
        duration: Real time [s].

    Returns:
        Number of messages sent; times of the changes, counted from the first message,
        shape (K,) [s]; delays of the changes, shape (K,) [s]; largest difference of the
        last commands and the final commands to the station's drivers [rad, 1].
    """
    home = client.arm[-1][1]
    target, closed = home.copy(), 0
    changes: list[Change] = []
    n, start = len(home), wall.monotonic()
    sent, next_change = 0, start + 1.0
    random = np.random.default_rng(0)
    for step in range(round(duration * rate)):
        wall.sleep(max(start + step / rate - wall.monotonic(), 0.0))
        now = wall.monotonic()
        if now >= next_change:
            joint = len(changes) % n
            changes.append(Change(now, joint, target[joint]))
            there_and_back = STEP if target[joint] == home[joint] else 0.0
            target[joint] = home[joint] + there_and_back
            # Random, so that changes fall anywhere between the station's reads.
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

    def deviation() -> float:
        return max(
            abs(client.closure[-1][1][0] - closed / 100.0),
            float(np.abs(client.arm[-1][1] - target).max()),
        )

    end = wall.monotonic() + _SETTLING
    while deviation() > 0.0 and wall.monotonic() < end:
        wall.sleep(0.05)
    times = np.array([change.time for change in changes])
    return sent, times - start, find_delays(client.arm, changes), deviation()


def find_delays(
    published: Sequence[tuple[float, Vector]], changes: Sequence[Change]
) -> Vector:
    """Return the time from each change until its joint left its rest [s].

    Args:
        published: Commanded arm positions as (real time [s], positions [rad]).
        changes: Commands.

    Returns:
        Delays, one per change; NaN if the joint did not move.
    """
    times = np.array([time for time, _ in published])
    positions = np.array([position for _, position in published])
    delays = []
    for change in changes:
        after = slice(int(np.searchsorted(times, change.time)), None)
        distance = np.abs(positions[after, change.joint] - change.rest)
        moved = np.flatnonzero(distance > _MOVED)
        delays.append(times[after][moved[0]] - change.time if len(moved) else np.nan)
    return np.array(delays)
