"""True poses of objects, for metrics, experiments and disturbances only."""

from __future__ import annotations

from collections.abc import Mapping

from pydrake.common.value import AbstractValue
from pydrake.geometry import GeometryConfigurationVector, GeometryId
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex, DeformableBody
from pydrake.systems.framework import Context

from drake_srg.lifetime import LeafSystem
from drake_srg.objects.soft import nearest_pose
from drake_srg.types import Vector


class ObjectPoses(LeafSystem):
    """Outputs the poses of bodies by name.

    .. pydrake_system::

        name: ObjectPoses
        input_ports:
        - body_poses
        - deformable_body_configuration (where there are soft objects)
        output_ports:
        - object_poses

    The inputs are the plant's (list[RigidTransform], GeometryConfigurationVector).
    `object_poses` is a dict[str, RigidTransform], X_WO by object name [m]. The pose of
    a soft object is the rigid motion nearest to that of its vertices.

    Args:
        bodies: The body of each object, rigid (its index) or soft.
    """

    def __init__(self, bodies: Mapping[str, BodyIndex | DeformableBody]) -> None:
        super().__init__()
        self._bodies = {n: b for n, b in bodies.items() if isinstance(b, BodyIndex)}
        # The geometry's id, and its undeformed vertices in the object's frame.
        self._soft: dict[str, tuple[GeometryId, Vector]] = {
            n: (b.geometry_id(), b.reference_positions().reshape(-1, 3).T)
            for n, b in bodies.items()
            if isinstance(b, DeformableBody)
        }
        poses = self.DeclareAbstractInputPort(
            name="body_poses", model_value=AbstractValue.Make([RigidTransform()])
        )
        tickets = {poses.ticket()}
        if self._soft:
            vertices = self.DeclareAbstractInputPort(
                name="deformable_body_configuration",
                model_value=AbstractValue.Make(GeometryConfigurationVector()),
            )
            tickets.add(vertices.ticket())
        self.DeclareAbstractOutputPort(
            name="object_poses",
            alloc=lambda: AbstractValue.Make({}),
            calc=self._calc_object_poses,
            prerequisites_of_calc=tickets,
        )

    def _calc_object_poses(self, context: Context, output: AbstractValue) -> None:
        body_poses = self.get_input_port(0).Eval(context)
        poses = {name: body_poses[body] for name, body in self._bodies.items()}
        if self._soft:
            vertices = self.get_input_port(1).Eval(context)
            for name, (geometry, p_OV) in self._soft.items():
                p_WV = vertices.value(geometry).reshape(-1, 3).T
                poses[name] = nearest_pose(p_OV, p_WV)
        output.set_value(poses)
