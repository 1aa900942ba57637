"""Responses of the servo laws: ours and both readings of the thesis's equation 2.3.

The base joints of an SRG move under a servo law alone, without the minimum-jerk
generator. The palm is fixed and the fingers are horizontal, so their weight has no
effect. The left base joint, which closes with positive angles, is judged. Expected
values follow from the gains, the torque limit and the joint's inertia.

The integral term as printed, K_I e q', is zero when the reference rests. With the
standard term, a grip winds up to the limit. Evaluated literally, e = q* - q drives the
joint ahead of its reference, and nothing holds it against a load.
"""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, MatrixGain, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper import JOINT_NAMES, SrgPositionDriver
from drake_srg.gripper.servo import GripperServo
from drake_srg.parsing import AddModel
from drake_srg.types import Vector

SHIPPED = SrgPositionDriver().servo  # gains of the driver
BANDWIDTH = 40.0  # of the shipped gains [rad/s]; see srg_position_driver.py
# A usual integral: a corner one decade below the bandwidth costs little phase.
_WITH_KI = dc.replace(SHIPPED, ki=[0.1 * BANDWIDTH * kp for kp in SHIPPED.kp])
_NEVER = 1e9  # so slow an anti-windup does nothing [s]
LAWS = {
    "pid": SHIPPED,  # K_I is 0
    # The register of an MX-64, and percent.
    "pid, 1023 steps": dc.replace(SHIPPED, pwm_steps=1023),
    "pid, 100 steps": dc.replace(SHIPPED, pwm_steps=100),
    "pid, K_I": _WITH_KI,
    "pid, K_I, no anti-windup": dc.replace(_WITH_KI, tracking_time=_NEVER),
    "printed": dc.replace(_WITH_KI, law="printed"),
    "printed, K_I = 0": dc.replace(SHIPPED, law="printed"),
    "literal": dc.replace(_WITH_KI, law="literal"),
    "literal, K_I = 0": dc.replace(SHIPPED, law="literal"),
}
STEP = 0.001  # of the plant, the log and the tabulated references [s]
_BASES = np.array([1.0, 1.0, 0.0, 0.0])  # moving and loaded joints of JOINT_NAMES
START, END, START_TIME = 0.5, 1.0, 0.1  # of the step [rad], [rad], [s]
LOAD = -0.2  # 1.8 N at the end of a straight finger [N m]
OPENING_TIME = 1.0  # of closing and opening [s]
BLOCKED = (0.1, 0.6)  # while 1 N m, more than the limit, holds the fingers open [s]
LIMIT = 0.3  # of the step, which asks for 1.48 of full PWM with the shipped gains
# 0.01 rad is 1.1 mm at the end of a straight finger, 0.111 m from the base hinge.
BAND = 0.01
NONE = ex.within(0.0, absolute=1e-6)  # but for round-off of a PWM or a torque
# Angle [rad], speed [rad/s] and acceleration [rad/s²] at times (K,) [s].
Reference = Callable[[Vector], tuple[Vector, Vector, Vector]]


def _hold(angle: Callable[[Vector], Vector]) -> Reference:
    """Return a reference that jumps, without speed."""
    return lambda time: (angle(time), 0.0 * time, 0.0 * time)


def _moves(start: float, *moves: tuple[float, float]) -> Reference:
    """Return minimum-jerk moves, at the joints' speed, from a start [rad].

    Each move begins at a time [s] and goes a distance [rad].
    """
    blend = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # as in minimum_jerk.py

    def reference(time: Vector) -> tuple[Vector, Vector, Vector]:
        found = np.zeros((3, len(time)))
        for since, distance in moves:
            duration = 15.0 / 8.0 * abs(distance) / SRG.joint_speed
            share = np.clip((time - since) / duration, 0.0, 1.0)
            for k in range(3):
                found[k] += distance * blend.deriv(k)(share) / duration**k
        return start + found[0], found[1], found[2]

    return reference


# Close and open; close to where closing hands send their base joints.
_close_and_open = _moves(0.3, (START_TIME, 1.0), (OPENING_TIME, -1.0))
_grip = _moves(START, (START_TIME, SRG.joint_limit - START))


def _sine(time: Vector) -> tuple[Vector, Vector, Vector]:
    """Return a sine between 0.4 and 1.2 rad at 1 Hz, from rest."""
    amplitude, w = 0.4, 2.0 * np.pi
    c, s = amplitude * np.cos(w * time), amplitude * np.sin(w * time)
    return 0.8 - c, w * s, w**2 * c


def _tight_limit(motion: Reference) -> float:
    """Return 0.7 of the feedforward PWM of a motion."""
    _, v, a = motion(np.arange(0.0, 2.0, STEP))
    return 0.7 * float(np.max(np.abs(SHIPPED.kff1[0] * v + SHIPPED.kff2[0] * a)))


@dc.dataclass(frozen=True)
class Motion:
    """A motion of the base joints; all functions take times (K,) [s]."""

    reference: Reference
    force_limit: float = LIMIT  # kappa, a fraction of full PWM
    load: Callable[[Vector], Vector] = np.zeros_like  # that closes a base joint [N m]
    target: Callable[[Vector], Vector] | None = None  # [rad]; None: the reference
    duration: float = 2.0  # s
    servo_period: float | None = None  # sample time [s]; None for that of its config


def _closed_and_opened(t: Vector) -> Vector:
    return np.where((t > START_TIME) & (t <= OPENING_TIME), 1.3, 0.3)


MOTIONS = {
    "step": Motion(_hold(lambda t: np.where(t > START_TIME, END, START))),
    # At 1 kHz, where the printed law does not start to oscillate.
    "load": Motion(
        _hold(lambda t: np.full_like(t, END)),
        load=lambda t: np.where(t > START_TIME, LOAD, 0.0),
        duration=4.0,
        servo_period=0.001,
    ),
    "blocked": Motion(
        _hold(lambda t: np.full_like(t, END)),
        load=lambda t: np.where((t > BLOCKED[0]) & (t <= BLOCKED[1]), -1.0, 0.0),
    ),
    # The fingers meet at 1.76 rad, before the reference arrives, and press.
    "grip": Motion(
        _grip, 1.0, target=lambda t: np.where(t > START_TIME, SRG.joint_limit, START)
    ),
    "minimum_jerk": Motion(_close_and_open, 1.0, target=_closed_and_opened),
    "minimum_jerk_limited": Motion(
        _close_and_open, _tight_limit(_close_and_open), target=_closed_and_opened
    ),
    "sine_limited": Motion(_sine, _tight_limit(_sine)),
    "sine": Motion(_sine, 1.0),
}


def trial(law: str, motion: str) -> ex.Measures:
    """Move the base joints under a servo law; return the motion of the left one.

    Its torque limit is at full PWM [N m]; the inertia, that of motor and straight
    finger [kg m²]; damping in [N m s/rad].
    """
    config, moved = LAWS[law], MOTIONS[motion]
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=STEP, discrete_contact_approximation="lagged"),
        builder,
    )
    gripper = AddModel(plant, "package://drake_srg/sdf/srg.sdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm", gripper))
    plant.Finalize()
    joints = [plant.GetJointByName(name, gripper) for name in JOINT_NAMES]
    order = [joint.index() for joint in joints]
    torque_limits = [
        plant.get_joint_actuator(i).effort_limit()
        for i in plant.GetJointActuatorIndices()
    ]
    to_ours = plant.MakeStateSelectorMatrix(order)  # of [q; v]
    encoders = builder.AddSystem(MatrixGain(to_ours))
    selector = plant.MakeActuatorSelectorMatrix(order)
    motors = builder.AddSystem(MatrixGain(np.diag(torque_limits) @ selector))
    period = moved.servo_period or config.period
    limited = dc.replace(config, force_limit=moved.force_limit, period=period)
    servo = builder.AddSystem(GripperServo(limited))
    time = np.arange(0.0, moved.duration + 1.5 * STEP, STEP)
    q, v, a = (np.outer(_BASES, row) for row in moved.reference(time))

    def table(values: Vector) -> Any:
        trajectory = PiecewisePolynomial.FirstOrderHold(time, values)
        return builder.AddSystem(TrajectorySource(trajectory))

    reference = table(np.vstack([q, v, a]))
    target = table(q if moved.target is None else np.outer(_BASES, moved.target(time)))
    loaded = to_ours[len(order) :, len(order) :].T @ _BASES
    load = table(np.outer(loaded, moved.load(time)))
    builder.Connect(plant.get_state_output_port(gripper), encoders.get_input_port())
    for system, port in (
        (encoders, servo.GetInputPort("state_measured")),
        (reference, servo.GetInputPort("reference")),
        (target, servo.GetInputPort("position_desired")),
        (servo, motors.get_input_port()),
        (motors, plant.get_actuation_input_port(gripper)),
        (load, plant.get_applied_generalized_force_input_port()),
    ):
        builder.Connect(system.get_output_port(), port)
    logs = [
        LogVectorOutput(system.get_output_port(), builder, STEP)
        for system in (reference, encoders, servo)
    ]
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    for joint, angle in zip(joints, q[:, 0], strict=True):
        joint.set_angle(plant_context, angle)
    simulator.AdvanceTo(moved.duration)
    asked, measured, pwm = (log.FindLog(context).data() for log in logs)
    i = joints[0].velocity_start()
    base = plant.GetJointActuatorByName("left_base_joint", gripper)
    return {
        "time [s]": logs[0].FindLog(context).sample_times(),
        "reference": asked[0],
        "speed": asked[len(joints)],
        "angle [rad]": measured[0],
        "PWM": pwm[0],
        "torque limit": base.effort_limit(),
        "inertia": plant.CalcMassMatrix(plant_context)[i, i],
        "damping": joints[0].default_damping(),
    }


def summary(own: ex.Trials) -> ex.Values:
    t: dict[str, Any] = {t["motion"]: t for t in own}
    found: ex.Values = {}
    for motion, judge in (
        ("step", _step),
        ("load", _load),
        ("grip", _grip_torque),
        ("minimum_jerk", _ends),
        ("minimum_jerk", _tracking),
        ("sine", _tracking),
        ("minimum_jerk_limited", _limited),
        ("sine_limited", _limited),
    ):
        if motion in t:
            found |= judge(own.name, t[motion])
    if "blocked" in t:
        found |= _windup(own.name, t["blocked"], t["step"])
    return found


def _rms(values: Vector) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _error(t: Any) -> Vector:
    return np.asarray(t["reference"] - t["angle [rad]"])


def _at_limit(law: str, t: Any) -> float:
    limit, steps = MOTIONS[t["motion"]].force_limit, LAWS[law].pwm_steps
    if steps:
        limit = np.floor(steps * limit) / steps
    return float(np.mean(np.abs(t["PWM"]) >= limit - 1e-9))


def rise_time(time: Vector, q: Vector, start: float, end: float) -> float:
    """Return the time from 10 % to 90 % of a step [s]; NaN if 90 % is not reached."""
    reached = np.maximum.accumulate((q - start) / (end - start))
    low, high = np.interp([0.1, 0.9], reached, time, right=np.nan)
    return float(high - low)


def overshoot(q: Vector) -> float:
    """Return how far q exceeds the end of the step, as a share of the step."""
    return float(max(0.0, np.max((q - END) / (END - START))))


def settling_time(time: Vector, error: Vector, band: float) -> float:
    """Return the time after which `|error|` stays in the band [s], or NaN."""
    outside = np.flatnonzero(np.abs(error) > band)
    first = outside[-1] + 1 if len(outside) else 0
    return float(np.append(time, np.nan)[first])


def _step(law: str, t: Any) -> ex.Values:
    config, step = LAWS[law], END - START
    if config.law == "literal":  # The reference is at its target at once.
        return {"step: largest PWM []": (np.max(np.abs(t["PWM"])), NONE)}
    time, q = t["time [s]"], t["angle [rad]"]
    after = time > START_TIME
    rise, over = rise_time(time, q, START, END), overshoot(q)
    settled = settling_time(time[after] - START_TIME, _error(t)[after], BAND)
    saturated = _at_limit(law, t) * MOTIONS["step"].duration
    acceleration = LIMIT * t["torque limit"] / t["inertia"]
    # No law is faster than full torque throughout.
    fastest = (np.sqrt(1.8) - np.sqrt(0.2)) * np.sqrt(step / acceleration)
    rises = [(rise, ex.at_least(fastest))]
    found: dict[str, Any] = {
        "step: rise time, 10 to 90 % [s]": rises,
        "step: overshoot [of the step]": over,
        "step: time at the limit [s]": saturated,
    }
    settling = f"step: settling time to {BAND} rad [s]"
    if config.law == "pid" and config.ki[0] == 0.0:
        # The standard law takes no longer than full torque to the middle and back,
        # followed by a critically damped step at its bandwidth w: 3.36 / w from 10 to
        # 90 %, 5.83 / w to 2 %, which is the band.
        there = 2.0 * np.sqrt(step / acceleration)
        rises.append((rise, ex.at_most(there + 3.36 / BANDWIDTH)))
        # It stays at the limit while K_P (step - a t²/2) - K_D a t > kappa.
        kp, kd = config.kp[0], config.kd[0]
        end = np.max(
            np.roots([-0.5 * kp * acceleration, -kd * acceleration, kp * step - LIMIT])
        )
        at_limit = ex.within(float(end), absolute=2.0 * config.period)
        return found | {
            "step: overshoot [of the step]": (over, ex.at_most(BAND / step)),
            settling: (settled, ex.at_most(there + 5.83 / BANDWIDTH)),
            "step: time at the limit [s]": (saturated, at_limit),
        }
    if config.law == "pid":
        return found | {settling: settled}
    # Only the joint's friction damps, and a servo that holds its torque for a period
    # reduces the damping by half a period times its stiffness.
    taken = 0.5 * config.period * config.kp[0] * t["torque limit"]
    swing = np.ptp(q[-round(0.5 / STEP) :])
    swings = ex.at_least(2.0 * BAND) if taken > t["damping"] else ex.number()
    return found | {"step: residual oscillation, peak to peak [rad]": (swing, swings)}


def _load(law: str, t: Any) -> ex.Values:
    error = float(np.mean(_error(t)[-round(1.0 / STEP) :]))
    config = LAWS[law]
    # The printed integral term, K_I e q', is zero where the reference rests.
    expected = -LOAD / (config.kp[0] * t["torque limit"])
    if config.law == "literal":  # Nothing resists, so the joint opens to its stop.
        expected = END
    bound = ex.within(expected, relative=0.05)
    if config.law == "pid" and config.ki[0] > 0:
        error, bound = abs(error), ex.at_most(BAND)
    return {f"load of {-LOAD} N m: remaining error [rad]": (error, bound)}


def _windup(law: str, t: Any, step: Any) -> ex.Values:
    beyond = max(0.0, float(np.max(-_error(t)[t["time [s]"] > BLOCKED[1]])))
    config, bound = LAWS[law], ex.number()
    # Back-calculation: no more than after a step.
    if config.law == "pid" and config.tracking_time < _NEVER:
        limit = (END - START) * overshoot(step["angle [rad]"])
        bound = ex.at_most(max(BAND, limit))
    return {"blocked for 0.5 s: overshoot after release [rad]": (beyond, bound)}


def _grip_torque(law: str, t: Any) -> ex.Values:
    """Judge the torque with which fingers press that cannot reach their reference."""
    config, rest = LAWS[law], slice(-round(0.3 / STEP), None)
    full = t["torque limit"]
    torque, error = float(np.mean(t["PWM"][rest])) * full, np.mean(_error(t)[rest])
    bound = ex.within(config.kp[0] * error * full, relative=0.05)
    if config.law == "literal":  # The reference has arrived at its target.
        bound = NONE
    elif config.law == "pid" and config.ki[0] > 0.0:  # winds up to the limit
        bound = ex.at_least(0.99 * MOTIONS["grip"].force_limit * full)
    return {"grip: torque at rest [N m]": (torque, bound)}


def _ends(law: str, t: Any) -> ex.Values:
    closing = t["time [s]"] <= OPENING_TIME
    closed = np.max(t["angle [rad]"][closing]) - t["reference"][closing][-1]
    opened = abs(float(np.mean(_error(t)[-round(0.3 / STEP) :])))
    bound = ex.number(spread=lambda error: max(0.1 * error, BAND))
    if LAWS[law].law == "pid":
        bound = ex.at_most(BAND)
    return {
        "minimum_jerk: overshoot closing [rad]": (max(0.0, closed), bound),
        "minimum_jerk: error after opening [rad]": (opened, bound),
    }


def _tracking(law: str, t: Any) -> ex.Values:
    config, speed, found = LAWS[law], t["speed"], {}
    for word, moving in (("closing", speed > 0.0), ("opening", speed < 0.0)):
        v = speed[moving]
        # Factor of the error in the printed law as our servo evaluates it.
        stiffness = config.kp[0] + config.ki[0] * v
        stiffness += config.kd[0] * v / (v**2 + config.printed_law_min_speed**2)
        # The literal feedback pushes the joint ahead of its reference, but for the
        # sine, which is its own target; a negative stiffness pushes it away.
        pushes = t["motion"] != "sine"
        if config.law != "literal":
            pushes = np.min(stiffness) < 0.0
        bound = ex.at_least(10.0 * BAND) if pushes else ex.number()
        if config.law == "pid":
            bound = ex.at_most(BAND)
        key = f"{t['motion']}: RMS error {word} [rad]"
        found[key] = (_rms(_error(t)[moving]), bound)
    return found


def _limited(law: str, t: Any) -> ex.Values:
    motion = t["motion"]
    return {
        f"{motion}: share at the limit []": _at_limit(law, t),
        f"{motion}: RMS error [rad]": _rms(_error(t)),
    }


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    peak = max(max(abs(t["PWM"])) / MOTIONS[t["motion"]].force_limit for t in trials)
    return {"all": {"largest PWM of all motions [kappa]": peak}}


servo_laws = ex.Experiment(
    "Responses of the servo laws: ours and both readings of the thesis's equation 2.3.",
    lambda: ex.grid(law=LAWS, motion=MOTIONS),
    trial,
    {"largest PWM of all motions": ex.at_most(1.0)},
    summary=summary,
    whole=whole,
    picture=[
        ex.Curves("time [s]", "angle [rad]", "reference", where={"motion": m}, title=m)
        for m in MOTIONS
    ],
)
