"""A finger sensor of your own: how close each link of the hand is to slipping."""

import dataclasses as dc

import numpy as np

from drake_srg import LeafSystem, Rig
from drake_srg.gripper import FingerSensorConfig, SrgPositionDriver
from drake_srg.simulation import bench_scenario
from drake_srg.station import register_gripper


@dc.dataclass(kw_only=True)
class SlipConfig(FingerSensorConfig):
    """Three-axis force sensors under the pads."""

    least_force: float = 0.5  # below this normal force, the reading is 0 [N]

    def AddSensor(self, builder, plant, gripper, layout):
        """Add the sensors, one on each link."""
        size = len(layout.sensor_names)
        return builder.AddNamedSystem("slip_sensors", SlipSensors(size, self))


class SlipSensors(LeafSystem):
    """Measures which share of the normal force acts along the pads.

    .. pydrake_system::

        name: SlipSensors
        input_ports:
        - contact_wrench
        output_ports:
        - friction_used

    `contact_wrench` (6m) is that of `ContactForceSensors`; `friction_used` (m) is the
    tangential force on each link over the normal force. At the friction coefficient,
    the link slips.
    """

    def __init__(self, size, config):
        super().__init__()
        self.config = config
        self.wrench = self.DeclareVectorInputPort("contact_wrench", 6 * size)
        self.DeclareVectorOutputPort(
            "friction_used",
            size,
            self.calc_friction_used,
            prerequisites_of_calc={self.wrench.ticket()},
        )

    def calc_friction_used(self, context, output):
        """Compute the output."""
        x, y, z = self.wrench.Eval(context).reshape(-1, 6)[:, 3:].T
        normal = np.maximum(-y, self.config.least_force)  # y points inwards
        touched = -y >= self.config.least_force
        output.SetFromVector(np.where(touched, np.hypot(x, z) / normal, 0.0))


@dc.dataclass(kw_only=True)
class SensitiveDriver(SrgPositionDriver):
    """The SRG with slip sensors."""

    slip: SlipConfig = dc.field(default_factory=SlipConfig)


register_gripper(SensitiveDriver)


def test_friction_used_is_tangential_over_normal_force():
    """Fix the sensors' input, and evaluate their output."""
    sensors = SlipSensors(2, SlipConfig())
    context = sensors.CreateDefaultContext()
    pressed, touched = [0, 0, 0, 3, -10, 4], [0, 0, 0, 1, -0.1, 0]
    sensors.wrench.FixValue(context, [*pressed, *touched])
    assert np.allclose(sensors.get_output_port().Eval(context), [0.5, 0.0])


def main() -> np.ndarray:
    """Lift a can on the bench; return the friction used, a row per sample."""
    bench = bench_scenario(
        overrides=["gripper=!SensitiveDriver {slip: {least_force: 1.0}}"],
        gripper_rpy=[0, 90, 0],
        home=[0, 0, 0.22],
    )
    rig = Rig(bench)
    rig.advance(1.5, closure=0.66)
    rig.move([0.0, 0.0, 0.3], 1.0)
    return rig.log()["gripper.friction_used"]


if __name__ == "__main__":
    print(main()[-1])  # of the base links, then of the tips, which hold the can
