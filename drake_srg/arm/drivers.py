"""The arm drivers among which a scenario's tag chooses."""

import dataclasses as dc

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder

from drake_srg.arm.driver import AddSampling, ArmDriver, ArmSignals, stiff_gains
from drake_srg.arm.impedance import ArmImpedanceDriver
from drake_srg.common.systems import (
    AddVelocityFeedforward,
    check_prepared,
    model_actuators,
)
from drake_srg.types import Vector


@dc.dataclass(kw_only=True)
class ArmPositionDriver(ArmDriver):
    """Stiff joint position control with gravity compensation.

    The plant solves this law implicitly, within its effort limits.
    """

    # Gains, one per joint [N m/rad or N/m] and [N m s/rad or N s/m]. Null: from the
    # arm's inertia and torques; see `stiff_gains`.
    kp: list[float] | None = dc.field(default=None, metadata={"ge": 0.0})
    kd: list[float] | None = dc.field(default=None, metadata={"ge": 0.0})

    def prepare_plant(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """Prepare the plant for the driver, before the plant is finalized.

        Makes the arm's actuators PD controllers.
        """
        super().prepare_plant(plant, arm)
        actuators = model_actuators(plant, arm)
        for key, gains in (("kp", self.kp), ("kd", self.kd)):
            if gains is not None:
                self.check_length(key, gains, len(actuators))
        for actuator in actuators:  # placeholders that `SetGains` replaces
            actuator.set_controller_gains(PdControllerGains(p=1.0, d=1.0))

    def SetGains(self, plant: MultibodyPlant, arm: ModelInstanceIndex) -> None:
        """Set the gains of an arm's actuators, if the driver uses them."""
        super().SetGains(plant, arm)
        check_prepared(plant, arm)
        kp, kd = self.gains(plant, arm)
        for i, actuator in enumerate(model_actuators(plant, arm)):
            actuator.set_controller_gains(PdControllerGains(p=kp[i], d=kd[i]))

    def gains(
        self, plant: MultibodyPlant, arm: ModelInstanceIndex
    ) -> tuple[Vector, Vector]:
        """Return kp and kd, shape (N,) each, for an arm in a finalized plant."""
        if self.kp is not None and self.kd is not None:
            return np.array(self.kp), np.array(self.kd)
        kp, kd = stiff_gains(plant, arm, np.array(self.home))
        kp = kp if self.kp is None else np.array(self.kp)
        return kp, kd if self.kd is None else np.array(self.kd)

    def AddControl(
        self,
        inner: DiagramBuilder,
        control_plant: MultibodyPlant,
        arm: str,
        signals: ArmSignals,
    ) -> None:
        """Add the control, and export `desired_state`, `actuation` or both."""
        desired, torques = signals.desired, []
        if signals.continuous:
            model = control_plant.GetModelInstanceByName(arm)
            _, kd = self.gains(control_plant, model)
            desired, torque = AddVelocityFeedforward(inner, desired, kd)
            torques.append(torque)
        if signals.gravity is not None:
            torques.append(AddSampling(inner, signals.gravity, self.period))
        inner.ExportOutput(desired, "desired_state")
        if torques:
            inner.ExportOutput(_AddSum(inner, torques), "actuation")


def _AddSum(inner: DiagramBuilder, torques: list[OutputPort]) -> OutputPort:
    """Return the sum of one or more torques."""
    if len(torques) == 1:
        return torques[0]
    size = torques[0].size()
    adder = inner.AddNamedSystem("torque", Adder(len(torques), size))
    for i, torque in enumerate(torques):
        inner.Connect(torque, adder.get_input_port(i))
    return adder.get_output_port()


DRIVERS: tuple[type[ArmDriver], ...] = (ArmPositionDriver, ArmImpedanceDriver)
