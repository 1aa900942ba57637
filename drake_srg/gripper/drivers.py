"""Gripper drivers by their tags in scenario files."""

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.driver import GripperDriver
from drake_srg.gripper.linkage_driver import LinkageDriver
from drake_srg.gripper.plant_servo_driver import PlantServoDriver
from drake_srg.gripper.srg_position_driver import SrgPositionDriver
from drake_srg.gripper.srg_tendon_driver import SrgTendonDriver

# The drivers of the package. The name of a driver's class is its tag in scenario files.
# To add a driver of your own, call `drake_srg.station.register_gripper`.
DRIVERS: tuple[type[GripperDriver], ...] = (
    SrgPositionDriver,
    SrgTendonDriver,
    PlantServoDriver,
    LinkageDriver,
)


def AddGripperDriver(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    gripper: ModelInstanceIndex,
    config: GripperDriver,
    seed: int = 0,
    *,
    name: str = "gripper_driver",
    scene_graph: SceneGraph | None = None,
) -> Diagram:
    """Add the driver of a configuration; see the drivers for their ports.

    Args:
        builder: Builder of the diagram.
        plant: Plant with the gripper, finalized.
        gripper: Its model instance.
        config: Configuration of the driver; its class chooses the driver.
        seed: Seed of the encoders' noise.
        name: Name of the driver in the diagram.
        scene_graph: See `GripperDriver.AddDriver`.

    Raises:
        ScenarioError: If the gripper lacks joints that the driver commands.
        ValueError: See `GripperDriver.AddDriver`.
    """

    def fits(driver: type[GripperDriver]) -> bool:
        names = driver.layout.joint_names
        return all(plant.HasJointNamed(name, gripper) for name in names)

    if not fits(type(config)):
        fitting = [f"!{driver.__name__}" for driver in DRIVERS if fits(driver)]
        raise ScenarioError(
            f"gripper: !{type(config).__name__} does not fit the model; "
            f"allowed: {', '.join(fitting) or 'none'}"
        )
    return config.AddDriver(
        builder, plant, gripper, seed, name=name, scene_graph=scene_graph
    )
