"""Contacts, distances and internal forces between the arms of a run."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    QueryObject,
    Role,
)
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.planning import RobotDiagramBuilder

from drake_srg.common.contacts import each_contact
from drake_srg.common.log_format import MODES, pose_key, row_to_pose
from drake_srg.scenario import RobotArm, Scenario, robot_arms
from drake_srg.simulation.measures import arm_states
from drake_srg.station.plant import Models
from drake_srg.types import Mode, Vector

# Radii of the search for the nearest pair of geometries, tried in this order [m].
# Larger distances count as the last radius.
_REACHES = (0.1, 0.4, 1.6)
# Column of a log with several arms: the largest contact force between two arms [N].
ARM_CONTACT = "arm_contact_force"
# Column of a log with arms that carry together; see `InternalForce` [N].
INTERNAL_FORCE = "internal_force"

# Modes in which both hands should carry the object.
_CARRIED = (Mode.LIFT, Mode.TRANSFER, Mode.PLACE)


class ArmContacts:
    """Reads the contact forces between different arms from a plant's contact results.

    A gripper counts as part of its arm.

    Args:
        plant: The finalized plant that computes the results.
        arms: The arms.
    """

    def __init__(self, plant: MultibodyPlant, arms: Sequence[RobotArm]) -> None:
        self._arm_of = {  # number of a geometry to the arm's name
            geometry.get_value(): arm.name
            for arm in arms
            for geometry in _geometries(plant, _models(arm))
        }

    def force(self, contacts: ContactResults) -> float:
        """Return the largest contact force between two arms [N]; 0 without contact.

        Args:
            contacts: Value of the plant's output port `contact_results`.
        """
        forces = [0.0]
        for contact in each_contact(contacts):
            pair = (self._arm_of.get(contact.id_A), self._arm_of.get(contact.id_B))
            if None not in pair and pair[0] != pair[1]:
                forces.append(float(np.linalg.norm(contact.F_Ac_W().translational())))
        return max(forces)


class InternalForce:
    """Reads the force with which two hands press on each other through an object.

    It is the internal force of Williams and Khatib, "The Virtual Linkage: A Model for
    Internal Forces in Multi-Grasp Manipulation", ICRA (1993): the components of the
    hands' forces, along the line between them, that cancel out.

    Args:
        plant: The finalized plant that computes the results.
        name: Model instance of the object.
        hands: Model instances of the two grippers.
    """

    def __init__(
        self, plant: MultibodyPlant, name: str, hands: tuple[str, str]
    ) -> None:
        self._object, *self._hands = (
            {geometry.get_value() for geometry in _geometries(plant, [model])}
            for model in (name, *hands)
        )

    def force(self, contacts: ContactResults) -> float:
        """Return the internal force [N], 0 unless both hands touch the object.

        It is positive if the hands press towards each other.

        Args:
            contacts: Value of the plant's output port `contact_results`.
        """
        forces, points = np.zeros((2, 3)), [list[Vector](), list[Vector]()]
        for contact in each_contact(contacts):
            pair = (contact.id_A, contact.id_B)
            for sign, own, other in ((1.0, *pair), (-1.0, *pair[::-1])):
                if own not in self._object:
                    continue
                for i, hand in enumerate(self._hands):
                    if other in hand:
                        forces[i] += sign * contact.F_Ac_W().translational()
                        points[i].append(contact.p_WC())
        if not all(points):
            return 0.0
        first, second = (np.mean(where, axis=0) for where in points)
        line = (second - first) / np.linalg.norm(second - first)
        return float(0.5 * (forces[0] - forces[1]) @ line)


def largest_internal_force(log: Mapping[str, Vector]) -> float | None:
    """Return the largest internal force in any sample of a run [N], or None.

    Args:
        log: Arrays of log.npz.
    """
    force = log.get(INTERNAL_FORCE)
    return None if force is None else float(np.max(np.abs(force)))


def carried_tilt(log: Mapping[str, Vector], pick: str) -> float | None:
    """Return the largest tilt of a carried object in any sample of a run [degrees].

    Only modes in which both hands should hold the object count. The result is None if
    they never carry it together.

    Args:
        log: Arrays of log.npz.
        pick: The object's name.
    """
    if INTERNAL_FORCE not in log or pose_key(pick) not in log:
        return None
    carried = np.isin(log["mode"], [MODES.index(mode) for mode in _CARRIED])
    if not np.any(carried):
        return None
    poses = log[pose_key(pick)][carried]
    up = np.array([row_to_pose(row).rotation().col(2)[2] for row in poses])
    return float(np.rad2deg(np.arccos(np.clip(np.min(up), -1.0, 1.0))))


def min_arm_distance(scenario: Scenario, log: Mapping[str, Vector]) -> float | None:
    """Return the least distance between two arms in a run [m]; None for a single arm.

    Grippers count as parts of their arms. Only the samples of the log are checked.
    Distances beyond 1.6 m count as 1.6 m.

    Args:
        scenario: The scenario of the run.
        log: Arrays of log.npz.
    """
    arms = robot_arms(scenario)
    if len(arms) < 2:
        return None
    builder = RobotDiagramBuilder(time_step=0.0)
    plant = builder.plant()
    Models.of(scenario).add_to(plant)
    plant.Finalize()
    filters = builder.scene_graph().collision_filter_manager()
    inspector = builder.scene_graph().model_inspector()
    every = GeometrySet(inspector.GetAllGeometryIds(Role.kProximity))
    filters.Apply(CollisionFilterDeclaration().ExcludeWithin(every))
    for two in itertools.combinations(arms, 2):
        pair = (GeometrySet(_geometries(plant, _models(arm))) for arm in two)
        filters.Apply(CollisionFilterDeclaration().AllowBetween(*pair))
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    graph = diagram.scene_graph()
    query_port = graph.get_query_output_port()
    query_context = graph.GetMyContextFromRoot(root)
    columns = [column for arm in arms for column in _columns(plant, arm, log)]
    q, nearest = plant.GetPositions(context), _REACHES[-1]
    for row in range(len(log["time"])):
        for index, values in columns:
            q[index] = values[row]
        plant.SetPositions(context, q)
        nearest = _distance(query_port.Eval(query_context), nearest)
    return nearest


def count_arm_contacts(log: Mapping[str, Vector]) -> int | None:
    """Return the number of times that arms touched each other; None for a single arm.

    Args:
        log: Arrays of log.npz.
    """
    if ARM_CONTACT not in log:
        return None
    touching = np.concatenate([[False], log[ARM_CONTACT] > 0.0])
    return int(np.count_nonzero(touching[1:] & ~touching[:-1]))


def _distance(query: QueryObject, most: float) -> float:
    """Return the least distance between geometries, but no more than `most` [m]."""
    for reach in (*(r for r in _REACHES if r < most), most):
        pairs = query.ComputeSignedDistancePairwiseClosestPoints(reach)
        if pairs:
            return min(float(pair.distance) for pair in pairs)
    return most


def _columns(
    plant: MultibodyPlant, arm: RobotArm, log: Mapping[str, Vector]
) -> list[tuple[int, Vector]]:
    """Return each joint's index in the plant's positions, and its logged positions."""
    model = plant.GetModelInstanceByName(arm.arm_model)
    numbers = np.arange(plant.num_positions(), dtype=float)
    own = plant.GetPositionsFromArray(model, numbers).astype(int)
    state = arm_states(log, [arm])
    assert state is not None
    found = list(zip(own, state.T, strict=False))
    if arm.gripper is not None:
        model = plant.GetModelInstanceByName(arm.gripper_model)
        names = arm.gripper.joint_names
        joints = [plant.GetJointByName(name, model) for name in names]
        fingers = log[f"{arm.gripper_model}.state_measured"].T
        indices = [joint.position_start() for joint in joints]
        found += zip(indices, fingers, strict=False)  # leaves out the speeds
    return found


def _models(arm: RobotArm) -> list[str]:
    """Return the model instances of an arm and its gripper."""
    return [arm.arm_model, *([arm.gripper_model] if arm.gripper else [])]


def _geometries(plant: MultibodyPlant, models: Iterable[str]) -> list[GeometryId]:
    """Return the collision geometries of model instances."""
    return [
        geometry
        for name in models
        for body in plant.GetBodyIndices(plant.GetModelInstanceByName(name))
        for geometry in plant.GetCollisionGeometriesForBody(plant.get_body(body))
    ]
