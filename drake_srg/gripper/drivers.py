"""Gripper drivers: what stands between a closure command and joint torques.

A scenario's tag chooses one; each has a file of its own.
"""

from typing import get_args

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.errors import ScenarioError
from drake_srg.gripper.linkage_driver import AddLinkageDriver, LinkageDriver
from drake_srg.gripper.srg_position_driver import (
    AddSrgPositionDriver,
    SrgPositionDriver,
)
from drake_srg.gripper.srg_tendon_driver import (
    AddSrgTendonDriver,
    SetTendonDynamics,
    SrgTendonDriver,
)

__all__ = [
    "AddGripperDriver",
    "AddLinkageDriver",
    "AddSrgPositionDriver",
    "AddSrgTendonDriver",
    "GripperDriver",
    "LinkageDriver",
    "SetTendonDynamics",
    "SrgPositionDriver",
    "SrgTendonDriver",
]

GripperDriver = SrgPositionDriver | SrgTendonDriver | LinkageDriver


def AddGripperDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: GripperDriver,
    seed: int = 0,
) -> Diagram:
    """Add the driver that a configuration asks for; see the drivers for their ports.

    Args:
        builder: Of the diagram.
        plant: Finalized.
        gripper: Its model instance.
        config: Of the driver; its class chooses one.
        seed: Of the encoders' noise.

    Raises:
        ScenarioError: If the gripper has not the joints that it drives.
    """
    fitting = [
        driver.__name__
        for driver in get_args(GripperDriver)
        if all(plant.HasJointNamed(name, gripper) for name in driver.layout.joint_names)
    ]
    asked = type(config).__name__
    if asked not in fitting:
        allowed = ", ".join(f"!{name}" for name in fitting) or "none of ours"
        raise ScenarioError(
            f"gripper: !{asked} does not fit the model; allowed: {allowed}"
        )
    match config:
        case SrgPositionDriver():
            return AddSrgPositionDriver(builder, plant, gripper, config, seed)
        case SrgTendonDriver():
            return AddSrgTendonDriver(builder, plant, gripper, config, seed)
        case LinkageDriver():
            return AddLinkageDriver(builder, plant, gripper, config, seed)
