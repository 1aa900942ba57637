import dataclasses as dc

import numpy as np
import pytest
from helpers import fix, port_table
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.multibody.math import SpatialAcceleration
from pydrake.systems.analysis import Simulator

from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper.drivers import SrgPositionDriver
from drake_srg.gripper.sensing import GraspDetector, GraspDetectorConfig
from drake_srg.gripper.sensors import FingerSensorConfig
from drake_srg.gripper.underactuation import FINGERS
from drake_srg.lifetime import LeafSystem
from gripper.srg_hand import Hand

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


def test_ports():
    assert port_table(GraspDetector(FINGERS)) == ({"triggered": 4}, {"grasped": 1})


def test_a_grasp_counts_after_the_delay():
    assert reports([BOTH] * 14) == [0] * 10 + [1] * 4


def test_without_a_delay_it_counts_at_once():
    assert reports([NONE, BOTH, NONE, BOTH], delay=0.0) == [0, 1, 0, 1]


@pytest.mark.parametrize("reading", [NONE, LEFT, [0, 1, 0, 1], [0, 0, 1, 0]])
def test_both_fingers_must_sense_something(reading):
    assert reports([reading] * 20) == [0] * 20


@pytest.mark.parametrize("reading", [[1, 1, 0, 0], [0, 0, 1, 1], [1, 0, 0, 1]])
def test_any_sensor_of_a_finger_counts(reading):
    assert reports([reading] * 12)[-1] == 1


def test_the_sensors_of_a_finger_may_take_turns():
    assert reports([BOTH, [0, 0, 1, 1]] * 6)[-1] == 1


def test_a_break_starts_the_delay_anew():
    assert reports([BOTH] * 12 + [LEFT] + [BOTH] * 12) == (
        [0] * 10 + [1] * 2 + [0] * 11 + [1] * 2
    )


@given(st.lists(st.tuples(*[st.integers(0, 1)] * 4), max_size=30))
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
