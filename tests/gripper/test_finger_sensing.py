import dataclasses as dc

import numpy as np
import pytest
from helpers import port_table
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialAcceleration

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.gripper.finger_sensor import FingerSensorConfig
from drake_srg.lifetime import LeafSystem
from gripper.srg_hand import Hand


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
    return Hand(config=Driver(copy=CopyConfig(sizes, copies), **fields))


def test_a_sensor_is_one_field_of_the_configuration():
    plain, more = Hand(config=Driver()), hand({"proximity": 4}, {"proximity": "near"})
    before, after = (port_table(h.driver) for h in (plain, more))
    assert after == (before[0], {**before[1], "near": 4})


def test_sensors_are_listed_in_the_order_of_their_fields():
    assert list(Driver().sensors()) == ["proximity", "touch"]
    assert list(Driver(copy=CopyConfig()).sensors()) == ["proximity", "touch", "copy"]


@pytest.mark.parametrize(("source", "size"), [("proximity", 4), ("contact_wrench", 24)])
def test_a_sensor_reads_the_sensors_before_it(source, size):
    wired = hand({source: size}, {source: "copied"})
    np.testing.assert_array_equal(wired.read("copied"), wired.read(source))


def test_a_sensor_reads_the_plant():
    wired = hand({"plant_state": 8}, {"plant_state": "copied"})
    context = wired.plant.GetMyMutableContextFromRoot(wired.root)
    wired.plant.SetPositions(context, wired.model, [0.1, 0.2, 0.3, 0.4])
    state = wired.plant.get_state_output_port(wired.model).Eval(context)
    np.testing.assert_array_equal(wired.read("copied"), state)


def test_a_sensor_reads_what_the_encoders_measure():
    wired = hand({"state_measured": 8}, {"state_measured": "copied"})
    wired.plant.SetPositions(
        wired.plant.GetMyMutableContextFromRoot(wired.root), wired.model, [0.1] * 4
    )
    np.testing.assert_array_equal(wired.read("copied"), wired.read("state_measured"))
    assert wired.read("copied")[0] == 0.1


class Accelerometer(FingerSensorConfig):
    """Reads a port that no other sensor reads."""

    def AddSensor(self, builder, plant, gripper, layout):
        system = LeafSystem()
        model = AbstractValue.Make([SpatialAcceleration()])
        system.DeclareAbstractInputPort("body_spatial_accelerations", model)
        return builder.AddNamedSystem("accelerometer", system)


def test_the_driver_connects_what_only_one_sensor_reads_of_the_plant():
    wired = Hand(config=Driver(copy=Accelerometer()))
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
