"""Hands on the bench: held objects, models beside them, and pushes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.common.schema import Transform
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import AddModel, AddWeld, ModelDirective
from pydrake.multibody.plant import ExternallyAppliedSpatialForce

import experiments.runner as ex
from drake_srg import Rig, Scenario
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.types import Vector

# A claim: no wire pulls with more than the servo gives.
FULL_FORCE = ex.at_most(TendonDriveConfig().full_wire_force, source="data sheet")


def is_free(rig: Rig) -> bool:
    """Return whether only the gripper touches the picked object."""
    return set(rig.contact_forces()) == {"gripper"}


def in_hand(log: Mapping[str, Vector]) -> Vector:
    """Return the object's position relative to the hand, p_GO (K, 3) [m].

    The gantry only translates, so a change is a motion in the hand.
    """
    p_GO: Vector = log["object_pose.thing"][:, :3] - log["arm.state_measured"][:, :3]
    return p_GO


def weld_model(scenario: Scenario, file: str, link: str, p_W: npt.ArrayLike) -> None:
    """Add one of our models, named as its file, with a link at p_W (3) in world [m]."""
    model, weld = ModelDirective(), ModelDirective()
    model.add_model, weld.add_weld = AddModel(), AddWeld()
    model.add_model.name = file
    model.add_model.file = f"package://drake_srg/sdf/{file}.sdf"
    weld.add_weld.parent, weld.add_weld.child = "world", f"{file}::{link}"
    weld.add_weld.X_PC = Transform(RigidTransform(p_W))
    scenario.directives = [*scenario.directives, model, weld]


def push(
    rig: Rig, body: str, force: npt.ArrayLike, p_BoBq_B: npt.ArrayLike = (0, 0, 0)
) -> None:
    """Push at a body's point (3) [m] with a force (3) in world [N], until told else."""
    applied = ExternallyAppliedSpatialForce()
    applied.body_index = body_of(rig, body).index()
    applied.p_BoBq_B = np.array(p_BoBq_B, dtype=float)
    applied.F_Bq_W = SpatialForce(tau=np.zeros(3), f=force)
    port = rig.diagram.GetInputPort("object_forces_cheat")
    port.FixValue(rig.context, AbstractValue.Make([applied]))


def body_of(rig: Rig, name: str) -> Any:
    """Return the body of an object, or one of the gripper's links."""
    if rig.plant.HasBodyNamed(name):
        return rig.plant.GetBodyByName(name)
    (index,) = rig.plant.GetBodyIndices(rig.plant.GetModelInstanceByName(name))
    return rig.plant.get_body(index)
