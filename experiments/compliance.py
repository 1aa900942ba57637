"""Placing into a recess by a stiff and by a compliant arm, with errors of the goal.

The kitchen's arm has taken a cylinder out of a recess, and sets it back where it
believes the recess to be. The recess leaves 1 mm all around. Only contact corrects its
error. Each grasp draws friction and mass, each insertion the error's direction and
height. Both drivers and all sizes of the error get the same draws.

The criteria were set before the first run. A yielding arm must seat the cylinder up to
an error of 1 mm. The hypothesis was that a stiff arm usually jams there.
"""

import dataclasses as dc
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import default_rng
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.solvers import Solve

import experiments.runner as ex
from drake_srg import Rig, load_scenario
from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Cylinder, Vector
from experiments.stands.holding import weld_model

# The compliant arm has Sunrise's default stiffness; its centre is the cylinder's lower
# end, where forces then turn nothing (Whitney, "Quasi-Static Assembly of Compliantly
# Supported Rigid Parts", J. Dyn. Sys., Meas., Control 104, 1982).
DRIVERS = {
    "position": "!ArmPositionDriver {}",
    "impedance": "!ArmImpedanceDriver {cartesian: "
    "{frame: 'gripper::palm', centre: [0.198, 0.0, 0.0]}}",
}
ERRORS = (0.0, 0.5e-3, 1.0e-3, 1.5e-3, 2.0e-3)  # in the plane [m]
_INSERTIONS = 10  # after each grasp, with each error
_DEEPEST = 2e-3  # the goal is up to this much too low [m]
_FRICTION, _MASS = (0.3, 0.8), (0.016, 0.024)  # drawn evenly; mass [kg]
# Seated: so near to the floor of the recess, and so upright.
_SEATED, _UPRIGHT = 0.5e-3, np.deg2rad(1.0)

# Middle of the table's top, in world [m]: it stands on the kitchen's table.
_TOP = np.array([0.6, 0.0, 0.18])
DEPTH = 0.005  # of the recess [m]; its clearance is 1 mm all around
_CYLINDER = Cylinder(0.0125, 0.05)
# Of the cylinder's middle.
_SEAT = _TOP + np.array([0.0, 0.0, 0.5 * _CYLINDER.length - DEPTH])
_DOWN = RotationMatrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
_GUESS = [0.0, 0.55, 0.0, -1.6, 0.0, 1.0, 0.0]  # a posture with the hand near there
# Of the fingertips above the recess's floor, besides 6 mm, in the palm's x [m].
_FINGER_ROOM = np.array([0.008, 0.0, 0.0])
_ABOVE = np.array([0.0, 0.0, 0.007])  # where an insertion begins, from the seat [m]
# Times [s]: lowering the hand, closing and lifting at the start; then moving aside,
# lowering, pressing and letting go.
_LOWER, _CLOSE, _LIFT, _REST = 0.6, 1.2, 0.4, 0.3
_ASIDE, _INSERT, _PRESS, _RELEASE = 0.1, 0.4, 0.1, 0.25
# From some starts the solver ends beside a posture that it finds from others: how far
# they are from the guess [rad].
_SPREADS = (0.0, 0.02, 0.05, 0.1, 0.2)
_SAMPLE = 0.01  # between samples of the contact force [s]
_UNLOGGED = 10.0  # a log would take an eighth of the time [s]
_OVERRIDES = (
    # At 5 ms, the light cylinder rattles in the recess when let go, as high as 1 mm.
    "plant_config.time_step=0.002",
    "objects=null",
    "task={pick: cylinder, place: {position: [0.6, 0.0], marker: ''}}",
    "ignored_contacts=[['arm::*', '*'], ['gripper::palm*', '*']]",
    "directives.gripper.add_model.file=package://drake_srg/sdf/srg_fast.sdf",
    # Signed distances to the many pieces of the recess take most of the time, and tell
    # nothing here: the base links stop where they touch.
    "gripper=!SrgPositionDriver {proximity: {period: 0.1}}",
)


class InsertionStand:
    """An arm that has taken a cylinder out of the recess, to set it back.

    The cylinder has a mass [kg] and friction; `arm` is a driver as in a scenario.
    """

    def __init__(self, arm: str, mass: float, friction: float) -> None:
        thing = (
            f"{{shape: !Cylinder {dc.asdict(_CYLINDER)}, mass: {mass}, "
            f"friction: {friction}, pose: {{translation: {_SEAT.tolist()}}}}}"
        )
        changes = [f"arm={arm}", f"objects.cylinder={thing}"]
        scenario = load_scenario("kitchen", overrides=[*_OVERRIDES, *changes])
        weld_model(scenario, "small_table_recess", "table_top", _TOP)
        self._plant = MakeModelsPlant(scenario)
        hand = SrgHand(["above"], [], scenario.planner.squeeze)
        (self._grasp,) = hand.grasps(_CYLINDER, RigidTransform())
        self._q_seat = self._posture(np.zeros(3), np.array(_GUESS))
        self._q_above = self._posture(_ABOVE, self._q_seat)
        scenario.arm.home = [float(x) for x in self._q_above]
        self.rig = rig = Rig(scenario, name="compliance", log_period=_UNLOGGED)
        rig.fix("gripper.closure_commanded", self._grasp.closure_open)
        rig.move(self._q_seat, _LOWER)
        rig.advance(_CLOSE, closure=self._grasp.closure_closed)
        rig.move(self._q_above, _LIFT)
        rig.advance(_REST)
        self._held = rig.context.Clone()

    def insert(self, error: Vector) -> Mapping[str, float]:
        """Set the held cylinder back, with an error of the goal (3,) in world [m].

        Return its height above the seat while the arm pressed, `stood`, and once it was
        let go, `height` [m], its `tilt` then [rad]; the largest force between cylinder
        and table, `peak`, and the last, `pressed` [N].
        """
        rig, time = self.rig, self.rig.time
        rig.context.SetTimeStateAndParametersFrom(self._held)
        rig.context.SetTime(time)
        rig.fix("gripper.closure_commanded", self._grasp.closure_closed)
        above = self._posture(error + _ABOVE, self._q_above)
        down = self._posture(error, self._q_seat)
        rig.fix("arm.position_commanded", self._q_above)
        rig.move(above, _ASIDE)
        forces = []
        for start in _SAMPLE * np.arange(round((_INSERT + _PRESS) / _SAMPLE)):

            def lowered(t: float, start: float = start) -> Vector:
                share = minimum_jerk_blend((start + t) / _INSERT)
                return above + share * (down - above)

            rig.advance(_SAMPLE, arm=lowered)
            forces.append(rig.contact_forces().get("support", 0.0))
        stood = rig.X_WO().translation()[2] - _SEAT[2]
        rig.advance(_RELEASE, closure=self._grasp.closure_open)
        X_WO = rig.X_WO()
        upright = np.clip(X_WO.rotation().matrix()[2, 2], -1.0, 1.0)
        return {
            "stood": float(stood),
            "height": float(X_WO.translation()[2] - _SEAT[2]),
            "tilt": float(np.arccos(upright)),
            "peak": max(forces),
            "pressed": forces[-1],
        }

    def _posture(self, offset: Vector, q_guess: Vector) -> Vector:
        """Return the posture in which the hand has the cylinder beside its seat."""
        p_GO = self._grasp.p_GO + _FINGER_ROOM
        p_WG = _SEAT + offset - _DOWN @ p_GO
        ik = InverseKinematics(self._plant)
        palm, world = self._plant.GetFrameByName("palm"), self._plant.world_frame()
        ik.AddPositionConstraint(palm, np.zeros(3), world, p_WG, p_WG)
        ik.AddOrientationConstraint(world, _DOWN, palm, RotationMatrix(), 1e-5)
        n = self._plant.num_positions()
        guess = np.concatenate([q_guess, np.zeros(n - len(q_guess))])
        ik.prog().AddQuadraticErrorCost(np.eye(n), guess, ik.q())
        rng = default_rng(0)
        for spread in _SPREADS:
            result = Solve(ik.prog(), guess + spread * rng.normal(size=n))
            if result.is_success():
                q: Vector = result.GetSolution(ik.q())[: len(q_guess)]
                return q
        raise RuntimeError(f"compliance: the hand cannot reach {p_WG}")


def cases(seeds: int = 20) -> list[ex.Case]:
    """Set the cylinder back many times, with each driver and error.

    Args:
        seeds: Grasps with each driver, each with its own friction and mass.
    """
    return ex.grid(driver=DRIVERS, seed=range(seeds))


def trial(driver: str, seed: int) -> ex.Measures:
    """Return the insertions after one grasp, lists by error."""
    random = np.random.default_rng(seed)
    friction, mass = random.uniform(*_FRICTION), random.uniform(*_MASS)
    angles = random.uniform(0.0, 2.0 * np.pi, _INSERTIONS)
    depths = random.uniform(0.0, _DEEPEST, _INSERTIONS)
    stand = InsertionStand(DRIVERS[driver], mass, friction)
    x, y = np.cos(angles), np.sin(angles)
    made = [
        [stand.insert(off) for off in np.array([error * x, error * y, -depths]).T]
        for error in ERRORS
    ]
    return {key: [[one[key] for one in own] for own in made] for key in made[0][0]}


_HYPOTHESIS = ("jammed", "position", 1.0e-3)
_JAMS = ex.at_least(0.5, known="the hypothesis is refuted")


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    found: dict[str, ex.Values] = {}
    for driver in DRIVERS:
        own = trials.where(driver=driver)
        for i, error in enumerate(ERRORS):
            stood, height, tilt, peak, pressed = (
                np.concatenate([t[key][i] for t in own])
                for key in ("stood", "height", "tilt", "peak", "pressed")
            )
            seated = (np.abs(height) < _SEATED) & (tilt < _UPRIGHT)
            n = len(stood)
            values: dict[str, Any] = {}
            for what, done in (("seated", seated), ("jammed", stood > _SEATED)):
                bound = _JAMS if (what, driver, error) == _HYPOTHESIS else None
                values |= ex.share(
                    what, sum(done), n, bound, spread=0.05, first=", share"
                )
            if driver == "impedance" and error <= 1.0e-3:
                least, _ = values["seated, at least []"]
                values["seated, at least []"] = (least, ex.at_least(0.9, spread=0.05))
            for what, forces in (("peak force", peak), ("force when pressed", pressed)):
                values[f"{what}, median [N]"] = np.quantile(forces, 0.5)
                values[f"{what}, 95 % quantile [N]"] = np.quantile(forces, 0.95)
            found[f"{driver}, {1e3 * error:.1f} mm"] = values
    return found


compliance = ex.Experiment(
    "Placing into a recess by a stiff and by a compliant arm, with errors of the goal.",
    cases,
    trial,
    by=("driver", "seed"),
    whole=whole,
    picture=[ex.Bars(["seated, share"]), ex.Bars(["peak force, median"])],
)
