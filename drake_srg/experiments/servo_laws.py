"""Step and tracking response of both servo laws, with the PWM limit active.

Judged is the left base joint, which closes with positive angles. What is expected of
the laws follows from their gains, the torque limit and the joint's inertia.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.response import overshoot, rise_time, rms, settling_time
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.experiments.servo_bench import STEP, Joint, Motion, Response, simulate
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.recording.figure import make_figure, style_axes
from drake_srg.types import Vector

SHIPPED = SrgPositionDriver().servo
BANDWIDTH = 40.0  # of its gains [rad/s]; see gripper/drivers.py
# The usual integral: its corner a decade below the bandwidth costs little phase.
_WITH_KI = dc.replace(SHIPPED, ki=[0.1 * BANDWIDTH * kp for kp in SHIPPED.kp])
LAWS = {
    "pid": SHIPPED,  # its K_I is 0
    "pid, K_I": _WITH_KI,
    "pid, K_I, no anti-windup": dc.replace(_WITH_KI, tracking_time=np.inf),
    "printed": dc.replace(_WITH_KI, law="printed"),
    "printed, K_I = 0": dc.replace(SHIPPED, law="printed"),
}
# 0.01 rad is 1.1 mm at the end of a straight finger, 0.111 m from the base hinge.
BAND = 0.01


# The motions.

START, END, START_TIME = 0.5, 1.0, 0.1  # rad, rad, s
LOAD = -0.2  # N m, 1.8 N at the end of a straight finger
BLOCKED = (0.1, 0.6)  # s; while 1 N m, more than the limit, holds the fingers open
# The shipped gains ask for 1.48 of full PWM at the step.
LIMIT = 0.3


def _step(time: Vector) -> tuple[Vector, Vector, Vector]:
    q = np.where(time > START_TIME, END, START)
    return q, 0.0 * q, 0.0 * q


def _rest(time: Vector) -> tuple[Vector, Vector, Vector]:
    q = np.full_like(time, END)
    return q, 0.0 * q, 0.0 * q


def _close_and_open(time: Vector) -> tuple[Vector, Vector, Vector]:
    """0.3 to 1.3 rad and back with minimum jerk at the joints' 3.67 rad/s."""
    duration = 15.0 / 8.0 * 1.0 / 3.67
    blend = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # as in minimum_jerk.py
    closing, opening = (np.clip((time - t) / duration, 0.0, 1.0) for t in (0.1, 1.0))
    q, v, a = (
        (blend.deriv(k)(closing) - blend.deriv(k)(opening)) / duration**k
        for k in range(3)
    )
    return 0.3 + q, v, a


def _sine(time: Vector) -> tuple[Vector, Vector, Vector]:
    """0.4 to 1.2 rad at 1 Hz, from rest."""
    amplitude, w = 0.4, 2.0 * np.pi
    c, s = amplitude * np.cos(w * time), amplitude * np.sin(w * time)
    return 0.8 - c, w * s, w**2 * c


def _tight_limit(motion: Callable[[Vector], tuple[Vector, Vector, Vector]]) -> float:
    """0.7 of what the feedforward of a motion asks for [full PWM]."""
    _, v, a = motion(np.arange(0.0, 2.0, STEP))
    return 0.7 * float(np.max(np.abs(SHIPPED.kff1[0] * v + SHIPPED.kff2[0] * a)))


MOTIONS = {
    "step": Motion(_step, LIMIT),
    # At 1 kHz, where the printed law does not build up a swing of its own.
    "load": Motion(
        _rest,
        LIMIT,
        load=lambda t: np.where(t > START_TIME, LOAD, 0.0),
        duration=4.0,
        servo_period=0.001,
    ),
    "blocked": Motion(
        _rest,
        LIMIT,
        load=lambda t: np.where((t > BLOCKED[0]) & (t <= BLOCKED[1]), -1.0, 0.0),
    ),
    "minimum_jerk": Motion(_close_and_open, 1.0),
    "minimum_jerk_limited": Motion(_close_and_open, _tight_limit(_close_and_open)),
    "sine_limited": Motion(_sine, _tight_limit(_sine)),
    "sine": Motion(_sine, 1.0),
}


# The experiment.


def run(track: Track) -> ExperimentResult:
    """Let every law make every motion."""
    cases = [(motion, law) for motion in MOTIONS for law in LAWS]
    responses: dict[str, dict[str, Response]] = {motion: {} for motion in MOTIONS}
    for motion, law in track(cases, label=", ".join):
        responses[motion][law], joint = simulate(LAWS[law], MOTIONS[motion])
    return ExperimentResult(
        judge(responses, joint),
        {motion: _columns(laws) for motion, laws in responses.items()},
        draw(responses),
    )


def judge(responses: Mapping[str, Mapping[str, Response]], joint: Joint) -> list[Row]:
    """Compare the responses, by motion and law, with what theory says of them."""
    peaks = [
        float(np.max(np.abs(response.pwm))) / MOTIONS[motion].force_limit
        for motion, laws in responses.items()
        for response in laws.values()
    ]
    rows = [Row.at_most("all", "largest PWM of all motions", 1.0, max(peaks), "kappa")]
    for law, response in responses["step"].items():
        rows += _judge_step(law, response, joint)
    for law, response in responses["load"].items():
        rows.append(_judge_load(law, response, joint))
    rows += _judge_windup(responses)
    for motion in ("minimum_jerk", "sine"):
        for law, response in responses[motion].items():
            rows += _judge_tracking(motion, law, response)
    for motion in ("minimum_jerk_limited", "sine_limited"):
        for law, response in responses[motion].items():
            share = _at_limit(motion, response)
            rows.append(Row.info(law, f"{motion}: share at the limit", share, ""))
            error = rms(response.error)
            rows.append(Row.info(law, f"{motion}: RMS error", error, "rad"))
    return rows


def _at_limit(motion: str, response: Response) -> float:
    """Share of the time that the PWM is at its limit."""
    limit = MOTIONS[motion].force_limit
    return float(np.mean(np.abs(response.pwm) >= limit - 1e-9))


def _judge_step(law: str, response: Response, joint: Joint) -> list[Row]:
    config, step = LAWS[law], END - START
    after = response.time > START_TIME
    time, error = response.time[after] - START_TIME, response.error[after]
    rise = rise_time(response.time, response.q, START, END)
    over = overshoot(response.q, START, END)
    settled = settling_time(time, error, BAND)
    saturated = _at_limit("step", response) * MOTIONS["step"].duration
    acceleration = LIMIT * joint.torque_limit / joint.inertia

    def name(quantity: str) -> tuple[str, str]:
        return law, f"step: {quantity}"

    # No law is faster than full torque all the way.
    fastest = (np.sqrt(1.8) - np.sqrt(0.2)) * np.sqrt(step / acceleration)
    rows = [Row.at_least(*name("rise time, 10 to 90 %"), fastest, rise, "s")]
    if law == "pid":
        # The standard one takes no longer than full torque to the middle and back
        # again, and a critically damped step of its bandwidth thereafter: 3.36 / w from
        # 10 to 90 %, 5.83 / w to 2 %, which is the band.
        there = 2.0 * np.sqrt(step / acceleration)
        # It is at the limit while K_P (step - a t²/2) - K_D a t > kappa.
        kp, kd = config.kp[0], config.kd[0]
        end = np.max(
            np.roots([-0.5 * kp * acceleration, -kd * acceleration, kp * step - LIMIT])
        )
        return [
            *rows,
            Row.at_most(
                *name("rise time, 10 to 90 %"), there + 3.36 / BANDWIDTH, rise, "s"
            ),
            Row.at_most(*name("overshoot"), BAND / step, over, "of the step"),
            Row.at_most(
                *name(f"settles within {BAND} rad"),
                there + 5.83 / BANDWIDTH,
                settled,
                "s",
            ),
            Row.within(
                *name("time at the limit"),
                float(end),
                saturated,
                "s",
                absolute=2.0 * config.period,
            ),
        ]
    rows.append(Row.info(*name("overshoot"), over, "of the step"))
    rows.append(Row.info(*name("time at the limit"), saturated, "s"))
    if config.law == "pid":
        rows.append(Row.info(*name(f"settles within {BAND} rad"), settled, "s"))
        return rows
    # Nothing damps but the joint's friction, and a servo that holds its torque for a
    # period takes half a period times its stiffness from that.
    taken = 0.5 * config.period * config.kp[0] * joint.torque_limit
    swing = float(np.ptp(response.q[-round(0.5 / STEP) :]))
    if taken > joint.damping:
        rows.append(Row.at_least(*name("still swings by"), 2.0 * BAND, swing, "rad"))
    else:
        rows.append(Row.info(*name("still swings by"), swing, "rad"))
    return rows


def _judge_load(law: str, response: Response, joint: Joint) -> Row:
    error = float(np.mean(response.error[-round(1.0 / STEP) :]))
    quantity = f"load of {-LOAD} N m: error left"
    config = LAWS[law]
    if config.law == "pid" and config.ki[0] > 0:
        return Row.at_most(law, quantity, BAND, abs(error), "rad")
    # The printed integral term, K_I e q', is zero where the reference rests.
    expected = -LOAD / (config.kp[0] * joint.torque_limit)
    return Row.within(law, quantity, expected, error, "rad", relative=0.05)


def _judge_windup(responses: Mapping[str, Mapping[str, Response]]) -> list[Row]:
    rows = []
    for law, response in responses["blocked"].items():
        released = response.time > BLOCKED[1]
        beyond = max(0.0, float(np.max(-response.error[released])))
        quantity = "blocked for 0.5 s: overshoots by"
        if law in ("pid", "pid, K_I"):  # no more than after a step
            step = responses["step"][law]
            limit = max(BAND, (END - START) * overshoot(step.q, START, END))
            rows.append(Row.at_most(law, quantity, limit, beyond, "rad"))
        else:
            rows.append(Row.info(law, quantity, beyond, "rad"))
    return rows


def _judge_tracking(motion: str, law: str, response: Response) -> list[Row]:
    config, speed = LAWS[law], response.reference_speed
    rows = []
    for word, moving in (("closing", speed > 0.0), ("opening", speed < 0.0)):
        error, v = rms(response.error[moving]), speed[moving]
        quantity = f"{motion}: RMS error {word}"
        # What multiplies the error in the printed law, as our servo evaluates it.
        stiffness = config.kp[0] + config.ki[0] * v
        stiffness += config.kd[0] * v / (v**2 + config.printed_law_min_speed**2)
        if config.law == "pid":
            rows.append(Row.at_most(law, quantity, BAND, error, "rad"))
        elif np.min(stiffness) < 0.0:  # pushes away from the reference
            rows.append(Row.at_least(law, quantity, 10.0 * BAND, error, "rad"))
        else:
            rows.append(Row.info(law, quantity, error, "rad"))
    return rows


def _columns(laws: Mapping[str, Response]) -> dict[str, Vector]:
    """Every fifth sample: as often as the shipped servo's."""
    any_response = next(iter(laws.values()))
    columns = {
        "time [s]": any_response.time[::5],
        "reference [rad]": any_response.reference[::5],
    }
    for law, response in laws.items():
        columns[f"{law}: angle [rad]"] = response.q[::5]
        columns[f"{law}: PWM"] = response.pwm[::5]
    return columns


_DRAWN = {
    "step": "Step at a limit of 0.3",
    "load": "0.2 N m of load, servo at 1 kHz",
    "blocked": "Blocked from 0.1 to 0.6 s",
    "minimum_jerk": "Closing and opening",
    "minimum_jerk_limited": "... with 0.7 of the PWM asked for",
    "sine_limited": "Sine, 0.7 of the PWM asked for",
}


def draw(responses: Mapping[str, Mapping[str, Response]]) -> Any:
    """Draw angle over PWM for six motions."""
    figure = make_figure(11.0, 8.5, "Left base joint under the servo laws")
    all_axes = figure.subplots(4, 3, height_ratios=[2, 1, 2, 1])
    for k, (motion, title) in enumerate(_DRAWN.items()):
        row, column = 2 * (k // 3), k % 3
        angle, pwm = all_axes[row, column], all_axes[row + 1, column]
        style_axes(angle, ylabel="angle [rad]" if column == 0 else "")
        style_axes(pwm, xlabel="time [s]", ylabel="PWM" if column == 0 else "")
        angle.sharex(pwm)
        angle.tick_params(labelbottom=False)
        angle.set_title(title, fontsize=9, loc="left")
        for law, response in responses[motion].items():
            # At rest both printed laws are the same.
            line = {"lw": 1.6 if law == "pid" else 1.0, "label": law}
            line["ls"] = (0, (3, 3)) if law == "printed, K_I = 0" else "-"
            angle.plot(response.time, response.q, **line)
            pwm.plot(response.time, response.pwm, **line)
        angle.plot(response.time, response.reference, "k--", lw=0.8, label="reference")
    figure.align_ylabels(all_axes[:, 0])
    handles, labels = all_axes[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=6, fontsize=8, frameon=False
    )
    return figure
