"""The kitchen's arm, which sets a cylinder into the recess of the five-axis arm."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
from numpy.random import default_rng
from pydrake.common.schema import Transform
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.parsing import AddModel, AddWeld, ModelDirective
from pydrake.solvers import Solve

from drake_srg.common.geometry import minimum_jerk_blend
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.rig import Rig
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.types import Cylinder, Vector

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
    "objects=null",
    "task={pick: cylinder, place: {position: [0.6, 0.0], marker: ''}}",
    "ignored_contacts=[['arm::*', '*'], ['gripper::palm*', '*']]",
    "directives.gripper.add_model.file=package://drake_srg/sdf/srg_fast.sdf",
    # Signed distances to the many pieces of the recess take most of the time, and tell
    # nothing here: the base links stop where they touch.
    "gripper=!SrgPositionDriver {proximity: {period: 0.1}}",
)


@dc.dataclass(frozen=True)
class Inserted:
    """How an insertion went.

    Attributes:
        stood: Height of the cylinder above its seat while the arm pressed [m].
        height: The same once the hand had let it go [m].
        tilt: Its tilt then [rad].
        peak: Largest force between cylinder and table until the release [N].
        pressed: That force at the end of the motion, before the release [N].
    """

    stood: float
    height: float
    tilt: float
    peak: float
    pressed: float


class InsertionStand:
    """An arm that has taken the cylinder out of the recess, to set it back.

    Args:
        arm: The arm's driver, as a scenario's `arm`.
        mass: Of the cylinder [kg].
        friction: Of the cylinder.
        time_step: Of the plant [s]. At 5 ms, the light cylinder rattles on the floor of
            the recess when let go, as high as 1 mm.
    """

    def __init__(
        self, arm: str, mass: float, friction: float, time_step: float = 0.002
    ) -> None:
        thing = (
            f"{{shape: !Cylinder {dc.asdict(_CYLINDER)}, mass: {mass}, "
            f"friction: {friction}, pose: {{translation: {_SEAT.tolist()}}}}}"
        )
        scenario = load_scenario(
            "kitchen",
            overrides=[
                *_OVERRIDES,
                f"arm={arm}",
                f"objects.cylinder={thing}",
                f"plant_config.time_step={time_step}",
            ],
        )
        assert scenario.arm is not None
        _add_table(scenario)
        self._plant = MakeModelsPlant(scenario)
        hand = SrgHand(["above"], [], scenario.planner.squeeze)
        (self._grasp,) = hand.grasps(_CYLINDER, RigidTransform())
        self._q_seat = self._posture(np.zeros(3), np.array(_GUESS))
        self._q_above = self._posture(_ABOVE, self._q_seat)
        scenario.arm.home = [float(x) for x in self._q_above]
        self.rig = Rig(scenario, name="compliance", log_period=_UNLOGGED)
        self._take()
        self._held = self.rig.context.Clone()

    def insert(self, error: Vector) -> Inserted:
        """Set the held cylinder into the recess, with an error of the goal.

        Every call begins with the cylinder held in the same way.

        Args:
            error: Of the goal, in world, shape (3,) [m].
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
        for k in range(round((_INSERT + _PRESS) / _SAMPLE)):
            start = k * _SAMPLE
            rig.advance(
                _SAMPLE,
                arm=lambda t, start=start: (
                    above + minimum_jerk_blend((start + t) / _INSERT) * (down - above)
                ),
            )
            forces.append(rig.contact_forces().get("support", 0.0))
        stood = rig.X_WO().translation()[2] - _SEAT[2]
        rig.advance(_RELEASE, closure=self._grasp.closure_open)
        X_WO = rig.X_WO()
        upright = np.clip(X_WO.rotation().matrix()[2, 2], -1.0, 1.0)
        return Inserted(
            float(stood),
            float(X_WO.translation()[2] - _SEAT[2]),
            float(np.arccos(upright)),
            max(forces),
            forces[-1],
        )

    def _take(self) -> None:
        rig = self.rig
        rig.fix("gripper.closure_commanded", self._grasp.closure_open)
        rig.move(self._q_seat, _LOWER)
        rig.advance(_CLOSE, closure=self._grasp.closure_closed)
        rig.move(self._q_above, _LIFT)
        rig.advance(_REST)

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
                break
        else:
            raise RuntimeError(f"compliance: the hand cannot reach {p_WG}")
        q: Vector = result.GetSolution(ik.q())[: len(q_guess)]
        return q


def _add_table(scenario: Scenario) -> None:
    """Add the table with the recess to a scenario."""
    model, weld = AddModel(), AddWeld()
    model.name = "recess"
    model.file = "package://drake_srg/sdf/small_table_recess.sdf"
    weld.parent, weld.child = "world", "recess::table_top"
    weld.X_PC = Transform(RigidTransform(_TOP))
    directives = ModelDirective(), ModelDirective()
    directives[0].add_model, directives[1].add_weld = model, weld
    scenario.directives = [*scenario.directives, *directives]
