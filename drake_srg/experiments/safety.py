"""How fast and how far the safety monitor stops the kitchen's arm after random faults.

The arm moves between random postures, at random shares of its speed limits, until
something fails in the middle of a motion. Nothing is in its way: this is about stops.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

from drake_srg.common.safety_states import SafetyState, StopReason, safety_state
from drake_srg.experiments.registry import Track
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.safety_stand import Stand
from drake_srg.recording.timeline import make_figure, style_axes
from drake_srg.simulation.rig import Rig
from drake_srg.types import Vector

# Faults and the reason that the monitor must name.
FAULTS = {
    "emergency stop": StopReason.EMERGENCY_STOP,
    "lost command": StopReason.NOT_FINITE,
    "jump": StopReason.SPEED,
    "kick": StopReason.ACCELERATION,
    "frozen commands": StopReason.ACCELERATION,
    "lost heartbeat": StopReason.STALE,
    "push": StopReason.FORCE,
}
# A robot that has lost its commands must be sent to rest within this time [s]: the time
# to notice, 0.05 s for a watchdog, and top speed over a stop's deceleration, 0.10 s for
# the slowest joint. The arm itself rests later, by the time in which its joints settle.
_MAX_STOP = 0.2
# A joint that is slower counts as resting [rad/s].
_RESTING = 0.01
_AFTER = 0.5  # watched after a fault [s]
_PUSH = 150.0  # N
_ARM = ("position_allowed", "state_measured", "torque_measured")
_LOGGED = (*(f"arm.{name}" for name in _ARM), "safety.state")
# A motor with this share of its effort limit can give no more.
_SATURATED = 0.99


@dc.dataclass(frozen=True)
class Case:
    """A fault and the number of its random draws."""

    fault: str
    number: int

    def __str__(self) -> str:
        return f"{self.fault}, {self.number + 1}"


@dc.dataclass(frozen=True)
class Stop:
    """What a stop looked like.

    Attributes:
        case: The fault.
        reason: The reason that the monitor named.
        share: Speed at the fault, as a share of the joints' limits.
        reaction: Time until the monitor braked [s].
        commanded: Time until the commanded arm was at rest [s].
        measured: Time until the measured arm was at rest [s].
        bound: The same by theory: when the commands rest, the driver's period, the
            time in which the joints settle, and the time until the next reading [s].
        effort: Greatest share of the motors' effort limits. At 1, the theory does not
            hold, because it knows no limits.
        distance: Way of the tool after the fault [m].
        off_path: Greatest distance of the allowed tool from the line through the
            commands up to the fault and, where they went on, after it [m].
        limits: Greatest shares of the limits of speed and of deceleration.
        drift: Motion of the allowed joints at rest [rad].
    """

    case: Case
    reason: StopReason
    share: float
    reaction: float
    commanded: float
    measured: float
    bound: float
    effort: float
    distance: float
    off_path: float
    limits: tuple[float, float]
    drift: float


def stop(stand: Stand, case: Case) -> tuple[Stop, dict[str, Vector]]:
    """Move the arm until a fault; return the stop, and the log."""
    random = np.random.default_rng([case.number, list(FAULTS).index(case.fault)])
    q, duration = stand.motion(stand.home, random)
    period = stand.period
    fault = round(random.uniform(0.3, 0.7) * duration / period)
    command = _with_fault(stand, case.fault, q, fault * period, random)
    half, rows = 0.5 * period, []
    # Without contact, a long step is accurate, and a short log saves most of the time.
    with Rig(stand.scenario, name="safety", period=half, log_period=1e3 * half) as rig:
        for i in range(fault + round(_AFTER / period)):
            if case.fault == "emergency stop" and i == fault:
                rig.fix("safety.estop", 1.0)
            if case.fault == "lost heartbeat" and i < fault:
                rig.fix("safety.heartbeat", rig.time)
            if case.fault == "push" and i == fault:
                _push(rig, random)
            rig.advance(half, arm=command(i * period))
            # Half a period after an update, the ports show what it has decided.
            rows.append({name: rig.measured(name) for name in _LOGGED})
            rig.advance(half)
    log = {name: np.array([row[name] for row in rows]) for name in _LOGGED}
    streams = case.fault in ("emergency stop", "lost heartbeat", "push")
    last = duration if streams else (fault - 1) * period
    path = [q(t) for t in np.arange(0.0, last + 0.5 * period, period)]
    return _measure(stand, case, log, fault, np.array(path)), log


def _with_fault(
    stand: Stand,
    fault: str,
    q: Callable[[float], Vector],
    since: float,
    random: np.random.Generator,
) -> Callable[[float], Vector]:
    """Return commands that are at fault from a time on [s]."""
    direction = random.choice([-1.0, 1.0], len(stand.home))
    jump = random.uniform(2.0, 20.0) * stand.limits.step * direction
    kick = random.uniform(2.0, 4.0) * stand.limits.bend * direction

    def command(t: float) -> Vector:
        if t < since - 1e-9:
            return q(t)
        if fault == "lost command":
            return np.full(len(stand.home), np.nan)
        if fault == "jump":
            return q(t) + jump
        if fault == "kick":
            return q(t) + kick
        if fault == "frozen commands":
            return q(since - stand.period)
        return q(t)

    return command


def _push(rig: Rig, random: np.random.Generator) -> None:
    """Push the palm in a random direction, from now on."""
    direction = random.normal(size=3)
    force = ExternallyAppliedSpatialForce()
    force.body_index = rig.plant.GetBodyByName("palm").index()
    push = _PUSH * direction / np.linalg.norm(direction)
    force.F_Bq_W = SpatialForce(np.zeros(3), push)
    port = rig.diagram.GetInputPort("object_forces_cheat")
    port.FixValue(rig.context, AbstractValue.Make([force]))


def _measure(
    stand: Stand, case: Case, log: dict[str, Vector], fault: int, path: Vector
) -> Stop:
    allowed, state = log["arm.position_allowed"], log["arm.state_measured"]
    states = [safety_state(row) for row in log["safety.state"]]
    period, n = stand.period, len(stand.home)
    braking = [i for i, (s, _) in enumerate(states) if s is not SafetyState.RUNNING]
    steps = np.diff(allowed, axis=0)
    bends = np.diff(steps, axis=0)
    speed = np.max(np.abs(state[:, n:]), axis=1)

    def rest(moving: Vector) -> float:
        last = np.flatnonzero(moving)[-1]
        return max(float(last + 1 - fault) * period, 0.0)

    tool = np.array([stand.tool.position(q) for q in state[fault:, :n]])
    line = np.array([stand.tool.position(q) for q in path])
    held = allowed[-20:]
    commanded = rest(np.any(steps != 0.0, axis=1))
    tail = stand.settling_time(held[-1], _RESTING)
    return Stop(
        case,
        states[-1][1],
        float(np.max(np.abs(state[fault, n:]) / stand.speed)),
        np.inf if not braking else (braking[0] - fault) * period,
        commanded,
        rest(speed > _RESTING),
        commanded + 2.0 * period + tail,
        float(np.max(np.abs(log["arm.torque_measured"][fault:]) / stand.efforts)),
        float(np.sum(np.linalg.norm(np.diff(tool, axis=0), axis=1))),
        float(max(_distance(stand.tool.position(q), line) for q in allowed[fault:])),
        (
            float(np.max(np.abs(steps) / stand.limits.step)),
            float(np.max(np.abs(bends) / stand.limits.brake)),
        ),
        float(np.max(np.ptp(held, axis=0))),
    )


def _distance(p: Vector, line: Vector) -> float:
    """Return how far a point is from a line through points, shape (K, 3) [m]."""
    a, d = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.sum(d * d, axis=1), 1e-30)
    u = np.clip(np.sum(d * (p - a), axis=1) / length, 0.0, 1.0)
    return float(np.min(np.linalg.norm(a + u[:, None] * d - p, axis=1)))


def run(track: Track, *, faults: int = 200) -> ExperimentResult:
    """Stop the arm after each of the faults in turn.

    Args:
        track: Shows progress.
        faults: How many in all.
    """
    kinds = list(FAULTS)
    cases = [Case(kinds[i % len(kinds)], i // len(kinds)) for i in range(faults)]
    stand = Stand()
    stops, logs = [], {}
    for case in track(cases):
        done, log = stop(stand, case)
        stops.append(done)
        logs[case] = log
    table: dict[str, Any] = {
        "fault": [s.case.fault for s in stops],
        "reason": [s.reason.value for s in stops],
        "speed [share of the limits]": [s.share for s in stops],
        "reaction [s]": [s.reaction for s in stops],
        "commanded stop [s]": [s.commanded for s in stops],
        "measured stop [s]": [s.measured for s in stops],
        "bound of that [s]": [s.bound for s in stops],
        "effort [share of the limits]": [s.effort for s in stops],
        "way of the tool [m]": [s.distance for s in stops],
        "off its path [m]": [s.off_path for s in stops],
    }
    return ExperimentResult(judge(stops, stand), {"stops": table}, draw(stops))


def judge(stops: Sequence[Stop], stand: Stand) -> Sequence[Row]:
    """Expect every fault to end in a stop, within the limits and in time."""
    wrong = [
        s for s in stops if s.reason is not FAULTS[s.case.fault] or s.reaction < 0.0
    ]
    total = f"{len(stops)} faults"
    rows = [
        Row.at_most(total, "stopped otherwise, or not", 0, len(wrong), ""),
        Row.at_most(total, "speed / limit", 1.0, max(s.limits[0] for s in stops), ""),
        Row.at_most(
            total, "deceleration / limit", 1.001, max(s.limits[1] for s in stops), ""
        ),
        Row.at_most(
            total, "motion once stopped", 0.0, max(s.drift for s in stops), "rad"
        ),
    ]
    for fault in FAULTS:
        own = [s for s in stops if s.case.fault == fault]
        if not own:
            continue
        reaction = max(s.reaction for s in own)
        if fault in ("lost heartbeat", "push"):
            rows.append(Row.info(fault, "reaction, longest", reaction, "s"))
        else:
            rows.append(
                Row.at_most(fault, "reaction, longest", stand.period, reaction, "s")
            )
        latest = max(s.commanded for s in own)
        rows.append(
            Row.at_most(fault, "commands at rest, latest", _MAX_STOP, latest, "s")
        )
        shares = [(s.effort >= _SATURATED, s.measured / s.bound) for s in own]
        free = max((share for saturated, share in shares if not saturated), default=0.0)
        most = 1.0 + 1e-9  # for rounding
        rows.append(Row.at_most(fault, "arm at rest / its bound", most, free, ""))
        full = max((share for saturated, share in shares if saturated), default=0.0)
        rows.append(Row.info(fault, "the same, motor at its limit", full, ""))
        latest = max(s.measured for s in own)
        rows.append(Row.info(fault, "arm at rest, latest", latest, "s"))
        way = max(s.distance for s in own)
        rows.append(Row.info(fault, "way of the tool, longest", way, "m"))
        off = max(s.off_path for s in own)
        rows.append(Row.info(fault, "tool off its path, farthest", off, "m"))
    return rows


def draw(stops: Sequence[Stop]) -> Any:
    """Draw times and ways of the stops over the speed at the fault."""
    figure = make_figure(9.0, 3.4, "Stops of the kitchen's arm after random faults")
    left, right = figure.subplots(1, 2)
    for fault in FAULTS:
        own = [s for s in stops if s.case.fault == fault]
        share = [s.share for s in own]
        left.plot(share, [1e3 * s.measured for s in own], ".", ms=5, label=fault)
        right.plot(share, [1e3 * s.distance for s in own], ".", ms=5)
    left.axhline(1e3 * _MAX_STOP, color="0.6", lw=1.0)
    style_axes(left, xlabel="speed [share of the limits]", ylabel="time to rest [ms]")
    style_axes(right, xlabel="speed [share of the limits]", ylabel="way [mm]")
    left.legend(fontsize=7, frameon=False, loc="upper left")
    return figure
