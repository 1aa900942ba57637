"""A bench that labels grasps: a floating object, a hand that closes, and a shake.

The object floats while the fingers close, as in ACRONYM (Eppner, Mousavian and Fox,
ICRA 2021, section III-B). So a grasp may come from any direction, and its label does
not depend on a support. Then the object gets its weight, which pulls it out of the
hand, because the hand points down. Finally, forces at its centre of mass shake it along
three axes at once, ever harder. They are the inertial forces in the frame of a shaking
hand (d'Alembert). Shaking the arm itself would jerk the hand, because its commands are
3/64 s apart.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

from drake_srg.common.exceptions import scenario_errors
from drake_srg.learning.envs.episode_station import EpisodeStation, SimulationError
from drake_srg.learning.envs.hand_task import episode_scenario
from drake_srg.learning.envs.scenes import CONTROL_PERIOD, Physics
from drake_srg.planning.grasps.fingers import Fingers
from drake_srg.planning.grasps.grasp_measures import Patch, merged, wrench_space
from drake_srg.planning.grasps.linkage_hand import LinkageFingers
from drake_srg.planning.grasps.sampled_grasps import SampledGrasp
from drake_srg.planning.grasps.srg_hand import SrgFingers
from drake_srg.scenario.load import draw_scenario
from drake_srg.scenario.typed_yaml import merge
from drake_srg.types import Vector

_G = 9.81  # m/s²
_GRAVITY_W = np.array([0.0, 0.0, -_G])
# Amplitude of the shake, all axes together, at its start and at its end, and the
# amplitude that a successful grasp survives [g].
_LEAST, _MOST, NEEDED = 0.4, 1.6, 1.0
# Duration of the shake [s], at least two periods, and its frequencies [Hz]: 2 Hz as in
# the environments' shake, and two higher ones, so that the force takes all directions.
_SHAKE = 1.0
_FREQUENCIES = np.array([2.0, 2.5, 3.0])
_REST = 4  # control periods with the weight alone
# Steps of `train` per control period, as in `PickPlaceEnv`: in steps of 23 ms, closing
# fingers jump over the wall of a mug.
_STEPS = 4
_POINTS = 5  # contact points per finger; `epsilon` takes longer with more
# Least and greatest time of closing [s], and the joint speed at which it ends [rad/s].
_LEAST_CLOSE, _MOST_CLOSE, _STILL = 0.2, 1.2, 0.05
# The object is lost once its centre of mass has moved this far in the hand [m]: half of
# a pad's width during the shake, and out of reach while the hand closes.
_LOST, _AWAY = 0.015, 0.1
_HEIGHT = 0.6  # of the gantry, so that nothing reaches the table [m]


@dc.dataclass(frozen=True)
class BenchHand:
    """A hand whose grasps are labelled.

    Attributes:
        fingers: Geometry of the fingers, for the search for grasps.
        driver: Driver of `Physics`, which determines the plant.
        coarse: Name of its SDF file for `train` and `fast`.
        fine: Name of its SDF file for `accurate`.
        changes: Further changes to the scenario's tree.
    """

    fingers: Fingers
    driver: str
    coarse: str
    fine: str
    changes: Mapping[str, Any]


HANDS: Mapping[str, BenchHand] = {
    "srg": BenchHand(SrgFingers(), "plant", "srg", "srg", {}),
    # Mimic joints close its linkages, and Drake's continuous plants have none. So
    # `train` is `lagged` in steps of 3 ms, as for `tendon`.
    "linkage": BenchHand(
        LinkageFingers(),
        "tendon",
        "linkage_gripper_fast",
        "linkage_gripper",
        {
            "gripper": {"_tag": "!LinkageDriver"},
            # Only the pads can meet; see clear_table_linkage.yaml.
            "ignored_contacts": [
                ["gripper::palm*", "gripper::*"],
                ["gripper::master_[!p]*", "gripper::*"],
                ["gripper::slave_[!p]*", "gripper::*"],
            ],
        },
    ),
}


@dc.dataclass(frozen=True, eq=False, kw_only=True)
class GraspLabel:
    """A grasp and its outcome.

    Attributes:
        grasp: The grasp.
        strength: Amplitude of the shake that lost the object, 0 .. 1.6 [g]: 1.6 if the
            grasp survived, 0 if the hand never held the object or dropped it by its
            weight alone.
        epsilon: Ferrari and Canny's measure of the contacts before the shake, merged to
            five points per finger, with unit forces; 0 without force closure.
        closure: Commanded closure, 0 .. 1.
        opened: Joint angles before closing, by name [rad].
        closed: Joint angles before the shake, by name [rad].
        failure: Drake's error message if the simulation failed.
    """

    grasp: SampledGrasp
    strength: float
    epsilon: float
    closure: float
    opened: Mapping[str, float]
    closed: Mapping[str, float]
    failure: str = ""

    @property
    def success(self) -> bool:
        """Whether the grasp survives 1 g."""
        return self.strength >= NEEDED

    @property
    def margin(self) -> float:
        """Strength beyond the required one, -1 .. 0.6 [g]."""
        return self.strength - NEEDED

    @property
    def force_closure(self) -> bool:
        """Whether the contacts can resist any wrench (Nguyen, IJRR 7:3, 1988)."""
        return self.epsilon > 0.0


class GraspBench(EpisodeStation):
    """A station that is built once and labels any number of grasps of one object.

    Args:
        model: Path or URL of the object's model, as in a scenario.
        scale: Metres per unit of a mesh.
        hand: One of `HANDS`.
        physics: `train`, `fast` or `accurate`; see `Physics`.

    Raises:
        ScenarioError: If the model does not fit the bench.
    """

    def __init__(
        self, model: str, scale: float, hand: str, physics: str = "train"
    ) -> None:
        self.hand = HANDS[hand]
        tree = Physics(physics, self.hand.driver, _STEPS).scenario_tree("learn_bench")
        file = self.hand.fine if physics == "accurate" else self.hand.coarse
        url = f"package://drake_srg/sdf/{file}.sdf"
        changes = {
            **self.hand.changes,
            "directives": {"gripper": {"add_model": {"file": url}}},
            "clutter": None,
            "objects": {"thing": {"model": model, "scale": scale, "position": [0, 0]}},
            "task": {"pick": "thing"},
        }
        tree = merge(tree, changes, "grasps")
        scenario = draw_scenario(tree, "grasps", 0).scenario
        with scenario_errors("grasps"):
            super().__init__(episode_scenario(scenario, ()))
        self._q: Vector = np.zeros(self.plant.num_positions(self._arm))
        self._q[2] = _HEIGHT
        context = self.plant_context
        self._palm = self.plant.GetBodyByName("palm", self._gripper)
        self.plant.SetPositions(context, self._arm, self._q)
        self._X_WG = self._palm.EvalPoseInWorld(context)
        self._p_OC = self._object.CalcCenterOfMassInBodyFrame(context)
        port = self.station.GetInputPort("object_forces_cheat")
        self._forces = port.FixValue(
            self.context, AbstractValue.Make([ExternallyAppliedSpatialForce()])
        )
        self._things = set(self.plant.GetCollisionGeometriesForBody(self._object))
        joints = self.plant.GetJointIndices(self._gripper)
        self._joints = [
            joint
            for joint in map(self.plant.get_joint, joints)
            if joint.num_positions() == 1
        ]

    def label(self, grasp: SampledGrasp) -> GraspLabel | None:
        """Close the hand on the object, shake it, and return the grasp's label.

        Returns:
            The label; None if the open hand would already touch the object.
        """
        fingers = self.hand.fingers
        opened = fingers.opened(grasp.half_gap)
        close = fingers.wrapped if grasp.wrapped else fingers.closed
        closure = close(grasp.width).closure
        self.reset_to(self._X_WG @ grasp.X_OG.inverse(), self._q, opened.joints)
        if self._touching():
            return None
        label = GraspLabel(
            grasp=grasp,
            strength=0.0,
            epsilon=0.0,
            closure=closure,
            opened=self._angles(),
            closed={},
        )
        try:
            return self._judge(label)
        except SimulationError as error:
            return dc.replace(label, closed=self._angles(), failure=str(error))

    def _judge(self, label: GraspLabel) -> GraspLabel:
        holds = self._close(label.closure)
        label = dc.replace(label, closed=self._angles())
        held = self.grasp() if holds else None
        if held is None or not held.patches:
            return label
        epsilon = wrench_space(self._per_finger(held.patches), held.body).epsilon
        return dc.replace(label, epsilon=epsilon, strength=self._shake(label.closure))

    def _per_finger(self, patches: Sequence[Patch]) -> list[Patch]:
        """Return the merged contacts of each finger; one presses along the palm's y."""
        y_W = self._X_WG.rotation().matrix()[:, 1]
        sides: dict[bool, list[Patch]] = {}
        for patch in patches:
            push = patch.normal_force @ (patch.n_W @ y_W)
            sides.setdefault(bool(push > 0.0), []).append(patch)
        found = []
        for side in sides.values():
            p, n, force = (
                np.concatenate([getattr(patch, key) for patch in side])
                for key in ("p_W", "n_W", "normal_force")
            )
            total = [patch.normal_force.sum() for patch in side]
            friction = np.average([patch.friction for patch in side], weights=total)
            f_W = np.sum([patch.f_W for patch in side], axis=0)
            points = merged(p, n, force, _POINTS)
            found.append(Patch(*points, float(friction), f_W))
        return found

    def _close(self, closure: float) -> bool:
        """Close the fingers, and return whether the object is still within reach."""
        start = self._p_GC()
        self._push(-_GRAVITY_W)
        for i in range(round(_MOST_CLOSE / CONTROL_PERIOD)):
            self.advance(self._q, closure)
            if np.linalg.norm(self._p_GC() - start) > _AWAY:
                return False
            late = (i + 1) * CONTROL_PERIOD >= _LEAST_CLOSE
            if late and self._finger_speed() < _STILL:
                break
        return True

    def _shake(self, closure: float) -> float:
        """Shake ever harder until the object is lost, and return the strength [g]."""
        start, count = self._p_GC(), round(_SHAKE / CONTROL_PERIOD)
        strength = 0.0  # at first, only the weight pulls
        for i in range(-_REST, count):
            if i >= 0:
                t = (i + 0.5) * CONTROL_PERIOD
                strength = _LEAST * (_MOST / _LEAST) ** (t / _SHAKE)
            directions = np.sin(2.0 * np.pi * _FREQUENCIES * (i + 0.5) * CONTROL_PERIOD)
            self._push(-strength * _G / np.sqrt(3.0) * directions)
            self.advance(self._q, closure)
            if np.linalg.norm(self._p_GC() - start) > _LOST:
                return strength
        return _MOST

    def _push(self, a_W: Vector) -> None:
        """Apply the force that gives the object an acceleration in world (3) [m/s²]."""
        force = ExternallyAppliedSpatialForce()
        force.body_index = self._object.index()
        force.p_BoBq_B = self._p_OC
        mass = self._object.get_mass(self.plant_context)
        force.F_Bq_W = SpatialForce(tau=np.zeros(3), f=mass * a_W)
        self._forces.GetMutableData().set_value([force])

    def _touching(self) -> bool:
        """Return whether anything touches the object."""
        port = self.plant.get_geometry_query_input_port()
        query = port.Eval(self.plant_context)
        pairs = query.ComputePointPairPenetration()
        return any({p.id_A, p.id_B} & self._things for p in pairs)

    def _p_GC(self) -> Vector:
        """Return the object's centre of mass in the palm, shape (3,) [m]."""
        X_WG = self._palm.EvalPoseInWorld(self.plant_context)
        p_GC: Vector = X_WG.inverse() @ (self.X_WO() @ self._p_OC)
        return p_GC

    def _angles(self) -> dict[str, float]:
        """Return the gripper's joint angles by name [rad]."""
        context = self.plant_context
        return {joint.name(): float(joint.get_angle(context)) for joint in self._joints}

    def _finger_speed(self) -> float:
        """Return the greatest speed of the gripper's joints [rad/s]."""
        speeds = self.plant.GetVelocities(self.plant_context, self._gripper)
        return float(np.abs(speeds).max())
