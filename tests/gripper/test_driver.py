import dataclasses as dc
from typing import ClassVar

import numpy as np
import pytest
from helpers import fix, port_table
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialAcceleration
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import MatrixGain

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.joint_errors import JointErrorsConfig
from drake_srg.gripper import SrgPositionDriver, SrgTendonDriver
from drake_srg.gripper.driver import (
    GraspDetector,
    GraspDetectorConfig,
    GripperControl,
    GripperDriver,
)
from drake_srg.gripper.drivers import DRIVERS
from drake_srg.gripper.sensors import SRG_FINGERS, FingerLayout, FingerSensorConfig
from drake_srg.gripper.servo import GripperServoConfig
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.lifetime import LeafSystem
from gripper.driven_hand import SrgHand

NONE, LEFT, BOTH = [0, 0, 0, 0], [1, 0, 1, 0], [1, 1, 0, 0]


def reports(readings, delay=0.1):
    """Return the reports 1 ms after each reading, one every 10 ms."""
    detector = GraspDetector(FINGERS, GraspDetectorConfig(post_contact_delay=delay))
    simulator = Simulator(detector)
    context = simulator.get_mutable_context()
    result = []
    for k, reading in enumerate(readings):
        fix(detector, context, triggered=np.array(reading, dtype=float))
        simulator.AdvanceTo(0.01 * k + 0.001)
        result.append(detector.get_output_port().Eval(context)[0])
    return result


def test_a_grasp_counts_after_the_delay():
    assert reports([BOTH] * 14) == [0] * 10 + [1] * 4


def test_without_a_delay_it_counts_at_once():
    assert reports([NONE, BOTH, NONE, BOTH], delay=0.0) == [0, 1, 0, 1]


def test_a_break_starts_the_delay_anew():
    assert reports([BOTH] * 12 + [LEFT] + [BOTH] * 12) == (
        [0] * 10 + [1] * 2 + [0] * 11 + [1] * 2
    )


# Both fingers sense something, be it with one sensor or the other, or one or none does.
READINGS = [BOTH, [1, 0, 0, 1], [0, 1, 1, 0], [0, 0, 1, 1], [1, 1, 1, 1]]
READINGS += [NONE, LEFT, [0, 1, 0, 1], [0, 0, 1, 0]]


@given(st.lists(st.sampled_from(READINGS), max_size=30))
def test_a_reported_grasp_lasted_for_the_delay(readings):
    both = [all(any(r[i] for i in finger) for finger in FINGERS) for r in readings]
    for k, grasped in enumerate(reports(readings, delay=0.05)):
        assert grasped == (k >= 5 and all(both[k - 5 : k + 1]))


class Sensor(LeafSystem):
    """Copies vectors from input ports to output ports."""

    def __init__(self, sizes, copies):
        super().__init__()
        for name, size in sizes.items():
            self.DeclareVectorInputPort(name, size)
        for source, name in copies.items():
            port = self.GetInputPort(source)

            def calc(context, output, port=port):
                output.SetFromVector(port.Eval(context))

            self.DeclareVectorOutputPort(name, sizes[source], calc)


@dc.dataclass
class CopyConfig(FingerSensorConfig):
    """A sensor that reads ports of these sizes."""

    sizes: dict[str, int] = dc.field(default_factory=dict)
    copies: dict[str, str] = dc.field(default_factory=dict)

    def AddSensor(self, builder, plant, gripper, layout):
        return builder.AddNamedSystem("copy", Sensor(self.sizes, self.copies))


@dc.dataclass(kw_only=True)
class Driver(SrgPositionDriver):
    """The SRG with one more sensor: one line."""

    copy: CopyConfig | None = None


def hand(sizes, copies, **fields):
    return SrgHand(config=Driver(copy=CopyConfig(sizes, copies), **fields))


def test_a_sensor_is_one_field_of_the_configuration():
    plain, more = (
        SrgHand(config=Driver()),
        hand({"proximity": 4}, {"proximity": "near"}),
    )
    before, after = (port_table(h.driver) for h in (plain, more))
    assert after == (before[0], {**before[1], "near": 4})


def test_sensors_are_listed_in_the_order_of_their_fields():
    assert list(Driver().sensors()) == ["proximity", "touch"]
    assert list(Driver(copy=CopyConfig()).sensors()) == ["proximity", "touch", "copy"]


@pytest.mark.parametrize(
    ("source", "size"),
    [("proximity", 4), ("contact_wrench", 24), ("state_measured", 8)],
)
def test_a_sensor_reads_the_encoders_and_the_sensors_before_it(source, size):
    wired = hand({source: size}, {source: "copied"})
    context = wired.plant.GetMyMutableContextFromRoot(wired.root)
    wired.plant.SetPositions(context, wired.model, [0.1] * 4)
    np.testing.assert_array_equal(wired.read("copied"), wired.read(source))


def test_a_sensor_reads_the_plant():
    wired = hand({"plant_state": 8}, {"plant_state": "copied"})
    context = wired.plant.GetMyMutableContextFromRoot(wired.root)
    wired.plant.SetPositions(context, wired.model, [0.1, 0.2, 0.3, 0.4])
    state = wired.plant.get_state_output_port(wired.model).Eval(context)
    np.testing.assert_array_equal(wired.read("copied"), state)


class Accelerometer(FingerSensorConfig):
    """Reads a port that no other sensor reads."""

    def AddSensor(self, builder, plant, gripper, layout):
        system = LeafSystem()
        model = AbstractValue.Make([SpatialAcceleration()])
        system.DeclareAbstractInputPort("body_spatial_accelerations", model)
        return builder.AddNamedSystem("accelerometer", system)


def test_the_driver_connects_what_only_one_sensor_reads_of_the_plant():
    wired = SrgHand(config=Driver(copy=Accelerometer()))
    port = wired.driver.GetInputPort("body_spatial_accelerations")
    assert len(port.Eval(wired.context)) == wired.plant.num_bodies()


def test_a_port_without_a_source_is_named_with_what_there_is():
    with pytest.raises(
        ValueError, match=r"'warmth' has no source .*proximity"
    ) as error:
        hand({"warmth": 4}, {})
    assert str(error.value).startswith("copy: input port")


def test_a_sensor_can_be_the_trigger():
    wired = hand({"proximity": 4}, {"proximity": "triggered"}, trigger="copy")
    # Distances are nonzero, so all fire: a grasp after the post-contact delay.
    wired.advance(0.15)
    assert wired.read("grasped") == [1.0]
    assert "triggered" not in port_table(wired.driver)[1]


def test_a_sensor_that_does_not_fire_cannot_be_the_trigger():
    with pytest.raises(ScenarioError, match=r"'copy' .* \(allowed: proximity, touch\)"):
        hand({"proximity": 4}, {"proximity": "near"}, trigger="copy")


@dc.dataclass(kw_only=True)
class TorqueDriver(GripperDriver):
    """The least that a driver is: closure 1 is 0.1 N m at each joint."""

    layout: ClassVar[FingerLayout] = SRG_FINGERS
    servo: GripperServoConfig = dc.field(
        default_factory=lambda: SrgPositionDriver().servo
    )

    def AddControl(self, inner, plant, gripper, sensing):
        torques = inner.AddNamedSystem("torques", MatrixGain(np.full((4, 1), 0.1)))
        return GripperControl(
            {"closure_commanded": torques.get_input_port()},
            {"actuation": torques.get_output_port()},
        )


def test_a_driver_is_its_control_and_sensors():
    inputs, outputs = port_table(SrgHand(config=TorqueDriver()).driver)
    ours = port_table(SrgHand(config=SrgPositionDriver()).driver)
    assert ours[0].items() - inputs.items() == {
        ("joint_position_commanded", 4),
        ("hold", 1),
        ("force_limit", 1),
    }
    assert ours[1].items() - outputs.items() == {("pwm", 4)}
    assert not inputs.keys() - ours[0].keys()


def test_the_control_drives_the_plant():
    hand = SrgHand(config=TorqueDriver())
    hand.command(closure_commanded=0.5)
    hand.simulator.AdvanceTo(0.02)
    net = hand.plant.get_net_actuation_output_port(hand.model)
    context = hand.plant.GetMyContextFromRoot(hand.root)
    assert net.Eval(context) == pytest.approx([0.05] * 4)


def test_every_driver_has_the_latency_of_its_configuration():
    errors = JointErrorsConfig(latency=0.05)
    hand = SrgHand(config=TorqueDriver(errors=errors))
    hand.simulator.AdvanceTo(0.05)
    hand.command(closure_commanded=1.0)
    hand.simulator.AdvanceTo(0.09)
    assert hand.read("actuation") == pytest.approx([0.0] * 4)
    hand.simulator.AdvanceTo(0.11)
    assert hand.read("actuation") == pytest.approx([0.1] * 4)


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_motor_has_an_entry_in_every_gain(driver):
    config = driver()
    for gain in ("kp", "ki", "kd", "kff1", "kff2"):
        assert len(getattr(config.servo, gain)) == config.num_motors


def test_one_motor_winds_the_wires_of_the_tendon_driver_alone():
    tendon = SrgTendonDriver()
    assert tendon.num_motors == 1
    assert tendon.wire_motor.drive is tendon.drive
    others = [driver() for driver in DRIVERS if driver is not SrgTendonDriver]
    assert [driver.wire_motor for driver in others] == [None] * len(others)


def test_wires_need_a_plant_with_steps():
    needing = [driver for driver in DRIVERS if driver.needs_discrete_plant]
    assert needing == [SrgTendonDriver]
