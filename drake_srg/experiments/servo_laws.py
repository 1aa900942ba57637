"""Responses of the servo laws: ours and both readings of the thesis's equation 2.3.

The experiment judges the left base joint, which closes with positive angles. Expected
values follow from the gains, the torque limit and the joint's inertia.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping

import numpy as np

from drake_srg.experiments.registry import Track
from drake_srg.experiments.response import overshoot, rise_time, rms, settling_time
from drake_srg.experiments.result import ExperimentResult
from drake_srg.experiments.row import Row
from drake_srg.experiments.servo_bench import STEP, Joint, Response, simulate
from drake_srg.experiments.servo_figure import draw
from drake_srg.experiments.servo_motions import (
    BLOCKED,
    END,
    LIMIT,
    LOAD,
    MOTIONS,
    OPENING_TIME,
    SHIPPED,
    START,
    START_TIME,
)
from drake_srg.types import Vector

BANDWIDTH = 40.0  # of the shipped gains [rad/s]; see srg_position_driver.py
# A usual integral: a corner one decade below the bandwidth costs little phase.
_WITH_KI = dc.replace(SHIPPED, ki=[0.1 * BANDWIDTH * kp for kp in SHIPPED.kp])
LAWS = {
    "pid": SHIPPED,  # K_I is 0
    # The register of an MX-64, and percent.
    "pid, 1023 steps": dc.replace(SHIPPED, pwm_steps=1023),
    "pid, 100 steps": dc.replace(SHIPPED, pwm_steps=100),
    "pid, K_I": _WITH_KI,
    "pid, K_I, no anti-windup": dc.replace(_WITH_KI, tracking_time=np.inf),
    "printed": dc.replace(_WITH_KI, law="printed"),
    "printed, K_I = 0": dc.replace(SHIPPED, law="printed"),
    "literal": dc.replace(_WITH_KI, law="literal"),
    "literal, K_I = 0": dc.replace(SHIPPED, law="literal"),
}
# 0.01 rad is 1.1 mm at the end of a straight finger, 0.111 m from the base hinge.
BAND = 0.01
_NOTHING = 1e-6  # Round-off of a PWM or a torque [any unit].


def run(track: Track) -> ExperimentResult:
    """Move the base joints along every motion under every law."""
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
    """Compare responses, by motion and law, with theory."""
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
    for law, response in responses["grip"].items():
        rows.append(_judge_grip(law, response, joint))
    for law, response in responses["minimum_jerk"].items():
        rows += _judge_ends(law, response)
    for motion in ("minimum_jerk", "sine"):
        for law, response in responses[motion].items():
            rows += _judge_tracking(motion, law, response)
    for motion in ("minimum_jerk_limited", "sine_limited"):
        for law, response in responses[motion].items():
            share = _at_limit(motion, law, response)
            rows.append(Row.info(law, f"{motion}: share at the limit", share, ""))
            error = rms(response.error)
            rows.append(Row.info(law, f"{motion}: RMS error", error, "rad"))
    return rows


def _at_limit(motion: str, law: str, response: Response) -> float:
    """Return the share of time during which the PWM is at its limit."""
    limit, steps = MOTIONS[motion].force_limit, LAWS[law].pwm_steps
    if steps:
        limit = np.floor(steps * limit) / steps
    return float(np.mean(np.abs(response.pwm) >= limit - 1e-9))


def _judge_step(law: str, response: Response, joint: Joint) -> list[Row]:
    config, step = LAWS[law], END - START
    if config.law == "literal":  # The reference is at its target at once.
        peak = float(np.max(np.abs(response.pwm)))
        return [Row.within(law, "step: largest PWM", 0.0, peak, "", absolute=_NOTHING)]
    after = response.time > START_TIME
    time, error = response.time[after] - START_TIME, response.error[after]
    rise = rise_time(response.time, response.q, START, END)
    over = overshoot(response.q, START, END)
    settled = settling_time(time, error, BAND)
    saturated = _at_limit("step", law, response) * MOTIONS["step"].duration
    acceleration = LIMIT * joint.torque_limit / joint.inertia

    def name(quantity: str) -> tuple[str, str]:
        return law, f"step: {quantity}"

    # No law is faster than full torque throughout.
    fastest = (np.sqrt(1.8) - np.sqrt(0.2)) * np.sqrt(step / acceleration)
    rows = [Row.at_least(*name("rise time, 10 to 90 %"), fastest, rise, "s")]
    if config.law == "pid" and config.ki[0] == 0.0:
        # The standard law takes no longer than full torque to the middle and back,
        # followed by a critically damped step at its bandwidth w: 3.36 / w from 10 to
        # 90 %, 5.83 / w to 2 %, which is the band.
        there = 2.0 * np.sqrt(step / acceleration)
        # It stays at the limit while K_P (step - a t²/2) - K_D a t > kappa.
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
                *name(f"settling time to {BAND} rad"),
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
        rows.append(Row.info(*name(f"settling time to {BAND} rad"), settled, "s"))
        return rows
    # Only the joint's friction damps, and a servo that holds its torque for a period
    # reduces the damping by half a period times its stiffness.
    taken = 0.5 * config.period * config.kp[0] * joint.torque_limit
    swing = float(np.ptp(response.q[-round(0.5 / STEP) :]))
    quantity = "residual oscillation, peak to peak"
    if taken > joint.damping:
        rows.append(Row.at_least(*name(quantity), 2.0 * BAND, swing, "rad"))
    else:
        rows.append(Row.info(*name(quantity), swing, "rad"))
    return rows


def _judge_load(law: str, response: Response, joint: Joint) -> Row:
    error = float(np.mean(response.error[-round(1.0 / STEP) :]))
    quantity = f"load of {-LOAD} N m: remaining error"
    config = LAWS[law]
    if config.law == "pid" and config.ki[0] > 0:
        return Row.at_most(law, quantity, BAND, abs(error), "rad")
    if config.law == "literal":  # Nothing resists, so the joint opens to its stop.
        return Row.within(law, quantity, END, error, "rad", relative=0.05)
    # The printed integral term, K_I e q', is zero where the reference rests.
    expected = -LOAD / (config.kp[0] * joint.torque_limit)
    return Row.within(law, quantity, expected, error, "rad", relative=0.05)


def _judge_windup(responses: Mapping[str, Mapping[str, Response]]) -> list[Row]:
    rows = []
    for law, response in responses["blocked"].items():
        released = response.time > BLOCKED[1]
        beyond = max(0.0, float(np.max(-response.error[released])))
        quantity = "blocked for 0.5 s: overshoot after release"
        config = LAWS[law]
        # Back-calculation: no more than after a step.
        if config.law == "pid" and np.isfinite(config.tracking_time):
            step = responses["step"][law]
            limit = max(BAND, (END - START) * overshoot(step.q, START, END))
            rows.append(Row.at_most(law, quantity, limit, beyond, "rad"))
        else:
            rows.append(Row.info(law, quantity, beyond, "rad"))
    return rows


def _judge_grip(law: str, response: Response, joint: Joint) -> Row:
    """Judge the torque with which fingers press that cannot reach their reference."""
    config, rest = LAWS[law], slice(-round(0.3 / STEP), None)
    torque = float(np.mean(response.pwm[rest])) * joint.torque_limit
    quantity = "grip: torque at rest"
    if config.law == "literal":  # The reference has arrived at its target.
        return Row.within(law, quantity, 0.0, torque, "N m", absolute=_NOTHING)
    if config.law == "pid" and config.ki[0] > 0.0:  # winds up to the limit
        full = MOTIONS["grip"].force_limit * joint.torque_limit
        return Row.at_least(law, quantity, 0.99 * full, torque, "N m")
    error = float(np.mean(response.error[rest]))
    expected = config.kp[0] * error * joint.torque_limit
    return Row.within(law, quantity, expected, torque, "N m", relative=0.05)


def _judge_ends(law: str, response: Response) -> list[Row]:
    """Judge where closing and opening end."""
    rows = []
    opening = response.time > OPENING_TIME
    closed = float(np.max(response.q[~opening]) - response.reference[~opening][-1])
    opened = abs(float(np.mean(response.error[-round(0.3 / STEP) :])))
    for quantity, error in (
        ("minimum_jerk: overshoot closing", max(0.0, closed)),
        ("minimum_jerk: error after opening", opened),
    ):
        if LAWS[law].law == "pid":
            rows.append(Row.at_most(law, quantity, BAND, error, "rad"))
        else:
            spread = max(0.1 * error, BAND)
            rows.append(Row.info(law, quantity, error, "rad", spread=spread))
    return rows


def _judge_tracking(motion: str, law: str, response: Response) -> list[Row]:
    config, speed = LAWS[law], response.reference_speed
    rows = []
    for word, moving in (("closing", speed > 0.0), ("opening", speed < 0.0)):
        error, v = rms(response.error[moving]), speed[moving]
        quantity = f"{motion}: RMS error {word}"
        # Factor of the error in the printed law as our servo evaluates it.
        stiffness = config.kp[0] + config.ki[0] * v
        stiffness += config.kd[0] * v / (v**2 + config.printed_law_min_speed**2)
        if config.law == "pid":
            rows.append(Row.at_most(law, quantity, BAND, error, "rad"))
        elif config.law == "literal":
            if motion == "sine":  # which is its own target: feedforward alone
                rows.append(Row.info(law, quantity, error, "rad"))
            else:  # The feedback pushes the joint ahead of its reference.
                rows.append(Row.at_least(law, quantity, 10.0 * BAND, error, "rad"))
        elif np.min(stiffness) < 0.0:  # pushes the joint away from the reference
            rows.append(Row.at_least(law, quantity, 10.0 * BAND, error, "rad"))
        else:
            rows.append(Row.info(law, quantity, error, "rad"))
    return rows


def _columns(laws: Mapping[str, Response]) -> dict[str, Vector]:
    """Return every fifth sample: the period of the shipped servo."""
    any_response = next(iter(laws.values()))
    columns = {
        "time [s]": any_response.time[::5],
        "reference [rad]": any_response.reference[::5],
    }
    for law, response in laws.items():
        columns[f"{law}: angle [rad]"] = response.q[::5]
        columns[f"{law}: PWM"] = response.pwm[::5]
    return columns
