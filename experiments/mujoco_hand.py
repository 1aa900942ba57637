"""The exported hand in MuJoCo: payload, and closing on nothing and on a can.

The trials are those of `payload_wrap`, `payload_pinch`, `free_closing` and
`closing_sequence`, judged alike. For two coefficients of friction, MuJoCo uses the
larger and Drake the harmonic mean, so the payload is measured with either.

An empty finger closes without gravity and contact, with the vendor's stops, while its
spool winds step by step. The reference is the vendor's statics.
"""

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

import experiments.runner as ex
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.gripper.tendon import wire_travel
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import bench_scenario
from drake_srg.types import Vector
from experiments import payload
from experiments.closing import DURATION, START, TOUCHED, can_in_hand, first
from experiments.free_closing import STOPS, THREE_PERCENT, VENDOR, deviations, vendors
from experiments.stands.mujoco_grasps import MujocoBench

_WIRE_FORCES = {"wrap": 200.0, "pinch": 125.0}  # as in payload_wrap, payload_pinch [N]
_DRAKES = ", friction as in Drake"
_FREE, _CAN = "closing on nothing", "closing on a can"
_STEPS, _FINE_STEPS = 250, 60  # of an empty hand's spool
_SETTLE = 2.0  # in which it comes to rest [s]
_LINKS = ("left_base", "right_base", "left_tip", "right_tip")
_COUNT = 2.0 * np.pi / 4096.0  # of a 12-bit encoder: less is no motion [rad]
_LOG = 0.01  # s
_TIP = "off by 0.15 degrees just after the tip starts, which we have not explained"


class Hand(MujocoBench):
    """The exported hand, with its joints and what touches the object."""

    def __init__(self, scenario: Scenario, options: Mapping[str, Any]) -> None:
        super().__init__(scenario, options)
        self._joints = [self.model.joint(f"gripper_{link}_joint") for link in _LINKS]
        self._home = np.array(scenario.arm.home)

    def advance(self, until: float, rise: float = 0.0) -> None:
        """Simulate until a time [s], the gantry `rise` above its home [m]."""
        while self.data.time < until:
            self.step(self._home + np.array([0.0, 0.0, rise]))

    def q(self) -> Vector:
        return np.array([self.data.qpos[j.qposadr[0]] for j in self._joints])

    def set_stops(self, stops: tuple[float, float]) -> None:
        """Set the upper stops of base and tip [rad]."""
        for joint, stop in zip(self._joints, np.repeat(stops, 2), strict=True):
            self.model.jnt_range[joint.id] = 0.0, stop

    def touched(self) -> dict[str, float]:
        """Return the normal force on the object by the body that touches it [N]."""
        own, found = self.thing.id, dict[str, float]()
        for i, contact in enumerate(self.data.contact):
            bodies = [int(self.model.geom_bodyid[geom]) for geom in contact.geom]
            if own in bodies:
                (other,) = {*bodies} - {own}
                force = np.zeros(6)
                mujoco.mj_contactForce(self.model, self.data, i, force)
                name = self.model.body(other).name
                found[name] = found.get(name, 0.0) + force[0]
        return found


def cases() -> list[ex.Case]:
    """Hold in both ways and directions, wrapped with each friction, and close."""
    holds = [
        f"{grip}, {direction}"
        for grip in payload.MASSES
        for direction in payload.DIRECTIONS
    ]
    # Pads and cylinder have the same friction, which is also its mean.
    other = [f"{name}{_DRAKES}" for name in holds if name.startswith("wrap")]
    return ex.grid(what=[*holds, *other, _FREE, _CAN])


def trial(what: str) -> ex.Measures:
    if what == _FREE:
        return _close_free()
    if what == _CAN:
        return _close_on_can()
    grip, direction = what.removesuffix(_DRAKES).split(", ")
    mass, options = payload.MASSES[grip], {"harmonic": True} if _DRAKES in what else {}
    found = payload.largest(lambda m: _hold(grip, direction, m, options), mass)
    return {
        f"{mass:g} kg held for [s]": found["held_for"],
        "slip while the load comes on [mm]": found["slip"],
        "creep while held [um/s]": found["creep"],
        "largest mass held [kg]": found["largest"],
    }


def _hold(
    grip: str, direction: str, mass: float, options: Mapping[str, Any]
) -> ex.Measures:
    lifted, end = (
        payload.CLOSE + payload.LIFT,
        payload.CLOSE + payload.LIFT + payload.HOLD,
    )
    bench = payload.payload_scenario(grip, direction, mass, payload.BENCH)
    limit = bench.gripper.wire_motor.drive.force_limit_of(_WIRE_FORCES[grip])
    hand, rows, others = Hand(bench, options), [], set[str]()
    hand.close(limit)
    for t in np.arange(_LOG, end + 0.5 * _LOG, _LOG):
        share = float(minimum_jerk_blend((t - payload.CLOSE) / payload.LIFT))
        hand.advance(t, share * payload.LIFT_HEIGHT)
        rows.append((t, hand.p_GO(), hand.q()))
        if abs(t - lifted) < 0.5 * _LOG:
            others = {n for n in hand.touched() if not n.startswith("gripper")}
    time, p_GO, q = (np.array(x) for x in zip(*rows, strict=True))
    found = payload.judge_hold(grip, time, p_GO, q)
    return found | ({"held_for": 0.0} if others else {})


def _close_free() -> ex.Measures:
    """Wind the wires of the empty hand in small steps to the vendor's largest force."""
    bench = bench_scenario(overrides=["object.present=false"])
    drive, hand = bench.gripper.wire_motor.drive, Hand(bench, {})
    hand.model.opt.gravity[:] = 0.0
    hand.model.geom_contype[:] = hand.model.geom_conaffinity[:] = 0
    hand.set_stops(STOPS[VENDOR])
    slide = hand.model.actuator_trnid[hand.wire, 0]
    place, dof = hand.model.jnt_qposadr[slide], hand.model.jnt_dofadr[slide]
    last = vendors()[0][-1]
    # The force rises steeply from the base's stop until the tip starts, and at the end.
    stops = STOPS[VENDOR]
    end = wire_travel(*stops) + 1.05 * last / drive.wire_stiffness
    steep = 8.0 / drive.wire_stiffness
    wounds = np.concatenate(
        [
            np.linspace(0.0, end, _STEPS + 1),
            wire_travel(stops[0], 0.0) + np.linspace(0.0, steep, _FINE_STEPS),
            end - np.linspace(0.0, steep, _FINE_STEPS),
        ]
    )
    force, angles = [], []
    for wound in np.sort(wounds):
        for _ in range(round(_SETTLE / hand.model.opt.timestep)):
            hand.data.qpos[place], hand.data.qvel[dof] = wound, 0.0
            mujoco.mj_step(hand.model, hand.data)
        force.append(-0.5 * float(hand.data.qfrc_passive[dof]))  # of both wires
        angles.append(hand.q())
    left, right = (np.array(angles)[:, list(finger)].T for finger in FINGERS)
    found: dict[str, Any] = {
        "wire force [N]": np.array(force),
        "base [rad]": left[0],
        "tip [rad]": left[1],
        "wire force reached [N]": force[-1],
        "largest left-right difference [rad]": np.max(np.abs(left - right)),
    }
    for name, q in zip(("base", "tip"), left, strict=True):
        for key, value in deviations(name, np.array(force), q).items():
            # Claims are made by name, below; that of angles is about shares.
            quantity = f"{name}: {key.replace(' [degrees]', ', absolute [degrees]')}"
            found[quantity] = value[0] if isinstance(value, tuple) else value
    return found


def _close_on_can() -> ex.Measures:
    bench = can_in_hand("!SrgTendonDriver {}")
    hand, rows = Hand(bench, {}), []
    hand.close(0.0)
    hand.advance(START)
    start = hand.p_GO()
    hand.close(bench.gripper.servo.force_limit)
    for t in np.arange(0.0, DURATION, 0.2 * _LOG):
        hand.advance(START + t)
        forces = hand.touched()
        touch = [forces.get(f"gripper_{link}_link", 0.0) for link in _LINKS]
        rows.append((t, touch, hand.q()))
    time, touches, q = (np.array(x) for x in zip(*rows, strict=True))
    return {
        "base touches at [s]": first(time, touches[:, 0] >= TOUCHED),
        "tip starts after the base touches [s]": first(time, q[:, 2] > _COUNT),
        "tip touches after the base [s]": first(time, touches[:, 2] >= TOUCHED),
        "base force at the end [N]": np.mean(touches[-1, :2]),
        "tip force at the end [N]": np.mean(touches[-1, 2:]),
        "base at the end [rad]": np.mean(q[-1, :2]),
        "tip at the end [rad]": np.mean(q[-1, 2:]),
        "motion of the can [mm]": 1e3 * float(np.linalg.norm(hand.p_GO() - start)),
    }


mujoco_hand = ex.Experiment(
    "The exported hand in MuJoCo: payload, and closing on nothing and on a can.",
    cases,
    trial,
    {
        **{
            f"{mass:g} kg held for": payload.CLAIMED for mass in payload.MASSES.values()
        },
        "base: angle at equal force": THREE_PERCENT,
        "tip: angle at equal force": dc.replace(THREE_PERCENT, known=_TIP),
    },
    picture=[
        ex.Bars(["largest mass held"]),
        ex.Curves("wire force [N]", ("base [rad]", "tip [rad]"), where={"what": _FREE}),
    ],
)
