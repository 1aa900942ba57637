"""What a sensor in the fingers has to offer so that every driver can carry it."""

import abc

from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder, System

from drake_srg.gripper.finger_layout import FingerLayout


class FingerSensorConfig(abc.ABC):
    """Configuration of a sensor in the fingers; derive a dataclass from it.

    A field of this type in a driver's configuration adds the sensor to that driver. See
    `AddFingerSensing` for how its ports are connected.
    """

    @abc.abstractmethod
    def AddSensor(
        self,
        builder: DiagramBuilder,
        plant: MultibodyPlant,
        gripper: ModelInstanceIndex,
        layout: FingerLayout,
    ) -> System:
        """Add the sensor to a driver, unconnected, and return it.

        Args:
            builder: The driver under construction.
            plant: With the gripper, finalized.
            gripper: Its model instance.
            layout: The links that carry sensors, in the order of the readings.
        """
