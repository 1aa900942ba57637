"""The truth about objects, for metrics, experiments and disturbances only."""

from __future__ import annotations

from collections.abc import Mapping

from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context

from drake_srg.lifetime import LeafSystem


class ObjectPoses(LeafSystem):
    """Poses of named bodies, by name.

    .. pydrake_system::

        name: ObjectPoses
        input_ports:
        - body_poses
        output_ports:
        - object_poses

    `body_poses` is the plant's (list[RigidTransform]); `object_poses` is
    dict[str, RigidTransform], X_WO by object name [m].
    """

    def __init__(self, bodies: Mapping[str, BodyIndex]) -> None:
        super().__init__()
        self._bodies = dict(bodies)
        poses = self.DeclareAbstractInputPort(
            name="body_poses", model_value=AbstractValue.Make([RigidTransform()])
        )
        self.DeclareAbstractOutputPort(
            name="object_poses",
            alloc=lambda: AbstractValue.Make({}),
            calc=self._calc_object_poses,
            prerequisites_of_calc={poses.ticket()},
        )

    def _calc_object_poses(self, context: Context, output: AbstractValue) -> None:
        poses = self.get_input_port().Eval(context)
        output.set_value({name: poses[body] for name, body in self._bodies.items()})
