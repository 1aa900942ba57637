import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from drake_srg.common.systems import input_ports
from drake_srg.robot.serve.commands import CommandError
from drake_srg.robot.serve.pictures import BLOBS, camera_topics
from drake_srg.robot.twin.comparison import (
    KINDS,
    ObjectComparison,
    Sighting,
    TwinMonitor,
    read_blobs,
)
from drake_srg.scenario.schema import TwinConfig
from drake_srg.types import Blob, BlobFlag
from experiments.stands.direct_node import make_message


def told(*blobs, time=1.5):
    """The message of `serve` about blobs."""
    topic = camera_topics("ceiling", None)[BLOBS]
    return topic.convert(make_message, time, blobs).data


def blob(name="can", X_WO=None, flags=()):
    X_WO = X_WO or RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.5, -0.2, 0.05])
    return Blob(name, "ceiling", (1.0, 2.0), X_WO, 1.0, frozenset(flags))


def test_the_messages_of_a_served_station_are_understood():
    hidden = blob("mug", flags=[BlobFlag.OCCLUDED])
    uncertain = blob("box", flags=[BlobFlag.UNCERTAIN])
    can, mug = read_blobs(told(blob(), hidden, uncertain))
    assert (can.name, can.time, can.clear) == ("can", 1.5, True)
    assert can.X_WO.IsNearlyEqualTo(blob().X_WO, 1e-9)
    assert (mug.name, mug.clear) == ("mug", False)


GOOD = json.loads(told(blob()))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no JSON",
        "[]",
        "null",
        "{}",
        '{"stamp": NaN, "blobs": []}',
        '{"stamp": 1.0, "blobs": 3}',
        '{"stamp": 1.0, "blobs": [{}]}',
        *(
            json.dumps({**GOOD, "blobs": [{**GOOD["blobs"][0], **change}]})
            for change in (
                {"position": [0.0, 0.0]},
                {"position": [0.0, 0.0, np.nan]},
                {"position": "here"},
                {"orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}},
                {"orientation": {"w": 1.0}},
                {"flags": ["imaginary"]},
                {"flags": None},
            )
        ),
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(CommandError):
        read_blobs(text)


PERIOD = 0.01
CONFIG = TwinConfig(still_time=0.1, patience=0.3)


def make_monitor():
    """A monitor of a two-joint arm with two fingers and two objects."""
    efforts = {"arm": np.array([100.0, 50.0])}
    return TwinMonitor(CONFIG, efforts, {"gripper": 2}, 2, PERIOD)


class Stand:
    """A monitor whose inputs the test sets."""

    def __init__(self):
        self.monitor = make_monitor()
        self.simulator = Simulator(self.monitor)
        self.context = self.simulator.get_mutable_context()
        for name, port in input_ports(self.monitor).items():
            self.fix(name, np.zeros(port.size()))
        self.time = 0.0

    def fix(self, name, value):
        self.monitor.GetInputPort(name).FixValue(self.context, value)

    def parted(self, seconds):
        """Advance, and return the kinds of which robot and twin have parted."""
        self.time += seconds
        self.simulator.AdvanceTo(self.time)
        parted = self.monitor.GetOutputPort("parted").Eval(self.context)
        return [kind for kind, value in zip(KINDS, parted, strict=True) if value]


# An input with a difference just above and just below the limit.
CASES = {
    "joint": ("arm_state_measured", [0.0, -1.01 * CONFIG.joint, 0.0, 0.0]),
    "torque": ("arm_external_expected", [0.0, 1.01 * CONFIG.torque * 50.0]),
    "finger": ("gripper_state_measured", [1.01 * CONFIG.finger, 0.0, 0.0, 0.0]),
    "object": ("object_error", [np.nan, 1.01 * CONFIG.object]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_difference_above_its_limit_that_lasts_is_reported(kind):
    stand = Stand()
    port, value = CASES[kind]
    assert stand.parted(1.005) == []
    stand.fix(port, value)
    patience = CONFIG.still_time if kind == "torque" else CONFIG.patience
    assert stand.parted(patience - 0.02) == []
    assert stand.parted(0.1) == [kind]


@pytest.mark.parametrize("kind", KINDS)
def test_it_begins_above_the_limit_and_is_over_well_below(kind):
    stand = Stand()
    port, value = CASES[kind]
    stand.fix(port, 0.98 * np.array(value))
    assert stand.parted(2.0) == []
    stand.fix(port, value)
    assert stand.parted(1.0) == [kind]
    stand.fix(port, 0.9 * np.array(value))
    assert stand.parted(1.0) == [kind]
    stand.fix(port, 0.7 * np.array(value))
    assert stand.parted(0.1) == []


def test_short_differences_do_not_add_up():
    stand = Stand()
    for _ in range(4):
        stand.fix(*CASES["finger"])
        assert stand.parted(0.2) == []
        stand.fix("gripper_state_measured", np.zeros(4))
        assert stand.parted(0.1) == []


def test_torques_of_a_moving_arm_do_not_count():
    stand = Stand()
    stand.fix(*CASES["torque"])
    stand.fix("arm_state_measured", [0.0, 0.0, 0.1, 0.0])
    assert stand.parted(2.0) == []
    stand.fix("arm_state_measured", np.zeros(4))
    assert stand.parted(0.18) == []
    assert stand.parted(0.05) == ["torque"]


@pytest.mark.parametrize(
    "port",
    ["arm_torque_measured", "gripper_state_measured", "object_error"],
)
def test_what_nobody_tells_is_no_difference(port):
    stand = Stand()
    size = stand.monitor.GetInputPort(port).size()
    stand.fix(port, np.full(size, np.nan))
    assert stand.parted(2.0) == []


torques = arrays(float, 2, elements={"min_value": -300.0, "max_value": 300.0})


def test_outputs_depend_on_their_own_inputs_alone():
    system = make_monitor()
    names = {
        output: {
            system.get_input_port(i).get_name()
            for i in range(system.num_input_ports())
            if system.HasDirectFeedthrough(i, system.GetOutputPort(output).get_index())
        }
        for output in ("joint_error", "torque_expected", "torque_residual")
    }
    torques = {
        f"arm_{name}"
        for name in ("torque_measured", "external_felt", "external_expected")
    }
    assert names == {
        "joint_error": {"arm_state", "arm_state_measured"},
        "torque_expected": torques,
        "torque_residual": torques,
    }


@given(torques, torques, torques)
def test_measured_is_expected_and_residual(needed, felt, simulated):
    system = make_monitor()
    context = system.CreateDefaultContext()
    measured = needed - felt
    for name, value in (
        ("arm_torque_measured", measured),
        ("arm_external_felt", felt),
        ("arm_external_expected", simulated),
    ):
        system.GetInputPort(name).FixValue(context, value)
    expected = system.GetOutputPort("torque_expected").Eval(context)
    residual = system.GetOutputPort("torque_residual").Eval(context)
    np.testing.assert_allclose(expected, needed - simulated, atol=1e-9)
    np.testing.assert_allclose(expected + residual, measured, atol=1e-9)


class Objects:
    """Two objects: the first moves along x at 0.5 m/s, the second rests at 0."""

    def __init__(self, placed_at=None):
        self.system = ObjectComparison(["mover", "rester"], PERIOD)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.fix("placed_at", placed_at or {"mover": 0.0, "rester": 0.0})
        self.fix("sightings", ())
        self.steps = 0

    def fix(self, name, value):
        port = self.system.GetInputPort(name)
        port.FixValue(self.context, AbstractValue.Make(value))

    def advance(self, seconds):
        for _ in range(round(seconds / PERIOD)):
            poses = {
                "mover": RigidTransform([0.5 * self.steps * PERIOD, 0.0, 0.0]),
                "rester": RigidTransform(),
            }
            self.fix("object_poses", poses)
            self.steps += 1
            self.simulator.AdvanceTo(self.steps * PERIOD)
        return self.system.get_output_port().Eval(self.context)

    def see(self, name, time, p_WO):
        self.fix("sightings", (Sighting(name, time, RigidTransform(p_WO)),))


def test_nothing_is_compared_before_it_is_seen():
    assert np.isnan(Objects().advance(0.5)).all()


@pytest.mark.parametrize("age", [0.0, 0.123, 1.0])
def test_a_late_picture_is_compared_with_the_time_it_was_taken(age):
    stand = Objects()
    stand.advance(1.5)
    time = 1.5 - age
    stand.see("mover", time, [0.5 * time, 0.03, 0.0])
    error = stand.advance(0.02)
    assert error[0] == pytest.approx(0.03, abs=1e-9)
    assert np.isnan(error[1])


def test_a_picture_of_the_future_waits():
    stand = Objects()
    stand.advance(1.0)
    stand.see("rester", 1.5, [0.0, 0.0, 0.2])
    assert np.isnan(stand.advance(0.4)).all()
    assert stand.advance(0.2)[1] == pytest.approx(0.2)


def test_pictures_from_before_an_object_was_placed_do_not_count():
    stand = Objects({"rester": 1.0})
    stand.advance(2.0)
    stand.see("rester", 0.9, [0.0, 0.0, 0.2])
    assert np.isnan(stand.advance(0.1)).all()
    stand.see("rester", 1.1, [0.0, 0.0, 0.1])
    assert stand.advance(0.1)[1] == pytest.approx(0.1)


def test_objects_that_were_never_placed_and_unknown_ones_do_not_count():
    stand = Objects({"rester": 0.0})
    stand.advance(1.0)
    stand.see("mover", 0.5, [9.0, 0.0, 0.0])
    stand.advance(0.1)
    stand.see("ghost", 0.5, [9.0, 0.0, 0.0])
    assert np.isnan(stand.advance(0.1)).all()
