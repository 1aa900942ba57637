"""Every public system climbs the ladder: ports, FixValue and Eval, an event.

The tests of a system say what it computes. This one says that it stands alone: it needs
no cell, no station and no scenario.
"""

import importlib
import inspect

import numpy as np
import pytest
from helpers import fix, port_table
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from drake_srg import (
    arm,
    gripper,
    load_scenario,
    objects,
    planning,
    recording,
    station,
    theses,
    vision,
)
from drake_srg.arm.impedance import JointSpring
from drake_srg.arm.safety.limits import JointLimits
from drake_srg.gripper import SRG_FINGERS, SrgPositionDriver
from drake_srg.planning.servoing.config import ServoCommand
from drake_srg.planning.servoing.tracker import FeatureSighting, PoseSighting
from drake_srg.types import Box, Cylinder, HeightMap, Mode

ROOMS = (arm, gripper, vision, objects, planning, theses, recording)
# Systems whose own tests climb the ladder: in a small plant, with a subclass of their
# own, or with a file.
ELSEWHERE = {
    "ProximitySensors",  # tests/gripper/test_sensors.py
    "StateMachine",  # tests/planning/test_state_machine_ports.py
    "Recorder",  # tests/recording/test_output.py
    "RosbagRecorder",  # tests/recording/test_rosbag.py
    "VideoRecorder",  # tests/recording/test_video.py
}
MODEL = vision.CameraModel(CameraInfo(32, 24, 0.8))
ABOVE = RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 1.0])
TABLE = vision.Surface((-0.2, -0.2), (0.2, 0.2), 0.0)


def color():
    image = ImageRgba8U(32, 24)
    image.mutable_data[:] = 200
    return Value(image)


def depth(metres=1.0):
    image = ImageDepth32F(32, 24)
    image.mutable_data[:] = metres
    return Value(image)


def images(*cameras, colored=True):
    """The inputs of systems that look down at a table from a height of 1 m."""
    found = {}
    for camera in cameras:
        if colored:
            found[f"{camera}.color_image"] = color()
        found[f"{camera}.depth_image"] = depth()
        found[f"{camera}.body_pose_in_world"] = Value(ABOVE)
    return found


def models():
    plant = MultibodyPlant(0.0)
    objects.AddModel(plant, "package://drake_srg/sdf/iiwa14.sdf", "arm")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("link_0"))
    plant.Finalize()
    return plant


PLANT = models()
ARM = PLANT.GetModelInstanceByName("arm")
HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
REST = [*HOME, *np.zeros(7)]
SAFETY = arm.SafetyConfig()
EFFORT = np.full(7, 100.0)
SERVO = SrgPositionDriver().servo
OPEN = np.zeros(8)
TABLE_MAP = HeightMap(np.array([0.3, -0.3]), 0.005, np.zeros((100, 100)))


def servo(method):
    """The visual servo of a scenario, which tracks nothing yet."""
    scenario = load_scenario(
        "kitchen_servoing", overrides=[f"planner.servo.method={method}"]
    )
    return station.MakeServo(scenario), station.MakeTracker(scenario)


def resting(system, **inputs):
    """Complete inputs: everything measured that is not given is at rest, at 0."""
    sizes = port_table(system)[0]
    vectors = {n: np.zeros(size) for n, size in sizes.items() if size is not None}
    return {**vectors, **inputs}


SYSTEMS = {
    "GravityCompensation": (
        lambda: arm.GravityCompensation(PLANT, ["arm"]),
        {"arm_state": REST},
    ),
    "ExternalTorqueObserver": (
        lambda: arm.ExternalTorqueObserver(PLANT, ["arm"], 0.01),
        {"arm_state": REST, "torque": np.zeros(7)},
    ),
    "ImpedanceControl": (
        lambda: arm.ImpedanceControl(
            JointSpring(PLANT, "arm", EFFORT),
            0.7,
            max_torque=EFFORT,
            max_acceleration=EFFORT,
            effort_limits=EFFORT,
            period=0.01,
        ),
        {"desired_state": REST, "state_measured": REST},
    ),
    "JerkLimitedReference": (
        lambda: arm.JerkLimitedReference(HOME, arm.JerkLimits(), 0.01),
        {"position_desired": HOME + 0.1},
    ),
    "TrajectoryFollower": (
        lambda: arm.TrajectoryFollower(HOME, 0.01),
        {"trajectory_desired": arm.trajectory_piece(np.ones(1), HOME[None] + 0.1)},
    ),
    "SafetyMonitor": (
        lambda: arm.SafetyMonitor(
            HOME, JointLimits.of_plant(PLANT, ARM, SAFETY, 0.01), SAFETY, 0.01
        ),
        {"position_commanded": HOME, "state_measured": REST},
    ),
    "GraspDetector": (
        lambda: gripper.GraspDetector(SRG_FINGERS.fingers),
        {"triggered": np.ones(4)},
    ),
    "ContactForceSensors": (
        lambda: gripper.ContactForceSensors({"tip": (BodyIndex(1), [])}),
        {
            "contact_results": Value(ContactResults()),
            "body_poses": Value([RigidTransform()] * 2),
        },
    ),
    "MasterSlaveReference": (
        gripper.MasterSlaveReference,
        {"closure_commanded": [0.5], "state_measured": OPEN[:4], "grasped": [0.0]},
    ),
    "GripperServo": (
        lambda: gripper.GripperServo(SERVO),
        {"reference": np.full(12, 0.1), "state_measured": OPEN},
    ),
    "MinimumJerkReference": (
        lambda: gripper.MinimumJerkReference(np.zeros(4)),
        {"position_desired": np.full(4, 0.1)},
    ),
    "SpoolCommand": (
        lambda: gripper.SpoolCommand(0.0076),
        {"closure_commanded": [0.5], "motor_state": OPEN[:2], "triggered": OPEN[:4]},
    ),
    "MotorTemperature": (
        gripper.MotorTemperature,
        {"pwm": [0.5], "motor_state": OPEN[:2]},
    ),
    "TendonDrive": (
        lambda: gripper.TendonDrive(gripper.TendonDriveConfig(), 0.01),
        {"pwm": [0.5], "state_measured": OPEN},
    ),
    "UnderactuationLogic": (
        gripper.UnderactuationLogic,
        {"closure_commanded": [0.5], "state_measured": OPEN, "triggered": OPEN[:4]},
    ),
    "Disturber": (
        lambda: objects.Disturber([], 0.01),
        {"mode": Value(Mode.IDLE), "object_poses": Value({})},
    ),
    "ObjectPoses": (
        lambda: objects.ObjectPoses({"can": BodyIndex(1)}),
        {"body_poses": Value([RigidTransform()] * 2)},
    ),
    "BlobLocalizer": (
        lambda: vision.BlobLocalizer(
            [vision.BlobTarget("can", Cylinder(), vision.ColorRange.around([1, 0, 0]))],
            {"top": MODEL},
        ),
        images("top"),
    ),
    "CalibratedPose": (
        lambda: vision.CalibratedPose(RigidTransform(), RigidTransform([0.1, 0, 0])),
        {"body_pose_in_world": Value(RigidTransform())},
    ),
    "CameraErrors": (
        lambda: vision.CameraErrors(
            vision.CameraErrorsConfig(), focal=30.0, seed=0, name="top"
        ),
        {
            "color_image": color(),
            "depth_image": depth(),
            "body_pose_in_world": Value(RigidTransform()),
        },
    ),
    "CameraLeveling": (
        lambda: vision.CameraLeveling(MODEL, [TABLE]),
        {
            "depth_image": depth(),
            "body_pose_in_world": Value(ABOVE),
        },
    ),
    "HeightMapper": (
        lambda: vision.HeightMapper({"top": MODEL}, TABLE),
        images("top", colored=False),
    ),
    "ObstacleFinder": (
        lambda: vision.ObstacleFinder({"top": MODEL}, [TABLE], {"can": Box()}),
        {**images("top", colored=False), "blobs": Value([])},
    ),
    "ThingLabeler": (
        lambda: vision.ThingLabeler(["all"], {}, {}, 0.0),
        {"height_map": Value(HeightMap(np.zeros(2), 0.01, np.zeros((3, 4))))},
    ),
}


PLANNERS = {
    "PickAndPlacePlanner": lambda: (
        station.MakePlanner(load_scenario("kitchen_fast")),
        {"blobs": Value([])},
    ),
    "ClearingPlanner": lambda: (
        station.MakeClearingPlanner(load_scenario("clear_table_fast")),
        {"height_map": Value(TABLE_MAP), "destination_map": Value(TABLE_MAP)},
    ),
    "TaughtPlanner": lambda: (
        station.MakeTaughtPlanner(load_scenario("assistive_arm_thesis")),
        {"blobs": Value([])},
    ),
    "ScriptedPlanner": lambda: (
        station.MakeScriptedPlanner(load_scenario("gripper_bench")),
        {},
    ),
    "ThesisBlobLocalizer": lambda: (
        theses.ThesisBlobLocalizer("can", "top", MODEL),
        images("top"),
    ),
    "PositionBasedServo": lambda: (
        servo("pbvs")[0],
        {"command": Value(ServoCommand.PASS), "sighting": Value(PoseSighting())},
    ),
    "ImageBasedServo": lambda: (
        servo("ibvs")[0],
        {"command": Value(ServoCommand.PASS), "sighting": Value(FeatureSighting())},
    ),
    "SurfaceTracker": lambda: (
        servo("pbvs")[1],
        {"color_image": color(), "depth_image": depth()},
    ),
    "SilhouetteTracker": lambda: (
        servo("ibvs")[1],
        {"color_image": color(), "depth_image": depth()},
    ),
}


def made(name):
    """A system, and what is fixed or connected at its inputs."""
    if name in SYSTEMS:
        make, inputs = SYSTEMS[name]
        return make(), inputs
    system, inputs = PLANNERS[name]()
    return system, resting(system, **inputs)


def public_systems():
    for room in ROOMS:
        for name in room.__all__:
            found = getattr(importlib.import_module(room.__name__), name)
            if inspect.isclass(found) and issubclass(found, LeafSystem):
                yield name


def test_every_public_system_is_here():
    assert {*public_systems()} == SYSTEMS.keys() | PLANNERS.keys() | ELSEWHERE


def is_sound(value):
    return not isinstance(value, np.ndarray) or not np.isinf(value).any()


def eval_outputs(system, context):
    for name, size in port_table(system)[1].items():
        value = system.GetOutputPort(name).Eval(context)
        assert is_sound(value)
        assert size is None or value.shape == (size,)


@pytest.mark.parametrize("name", [*SYSTEMS, *PLANNERS])
def test_a_system_stands_alone(name):
    system, inputs = made(name)
    assert inputs.keys() <= port_table(system)[0].keys()
    context = system.CreateDefaultContext()
    fix(system, context, **inputs)
    eval_outputs(system, context)
    simulator = Simulator(system, context)
    simulator.Initialize()
    simulator.AdvanceTo(0.1)  # the longest period: an event or more
    eval_outputs(system, context)


@pytest.mark.parametrize(
    ("name", "port", "beyond", "bound"),
    [
        ("GripperServo", "force_limit", 7.0, 1.0),
        ("GripperServo", "force_limit", -7.0, 0.0),
        ("MasterSlaveReference", "closure_commanded", 3.0, 1.0),
        ("MasterSlaveReference", "closure_commanded", -3.0, 0.0),
        ("MotorTemperature", "pwm", 7.0, 1.0),
        ("MotorTemperature", "pwm", -7.0, -1.0),
        ("SafetyMonitor", "speed_override", 7.0, 1.0),
        ("SafetyMonitor", "speed_override", -7.0, 0.0),
        ("SpoolCommand", "closure_commanded", 3.0, 1.0),
        ("SpoolCommand", "closure_commanded", -3.0, 0.0),
        ("TendonDrive", "pwm", 7.0, 1.0),
        ("TendonDrive", "pwm", -7.0, -1.0),
        ("UnderactuationLogic", "closure_commanded", 3.0, 1.0),
        ("UnderactuationLogic", "closure_commanded", -3.0, 0.0),
    ],
)
def test_a_value_beyond_the_bounds_of_a_port_counts_as_the_bound(
    name, port, beyond, bound
):
    make, inputs = SYSTEMS[name]

    def outputs(value):
        system = make()
        simulator = Simulator(system)
        context = simulator.get_mutable_context()
        fix(system, context, **{**inputs, port: value})
        simulator.AdvanceTo(0.1)
        every = map(system.get_output_port, range(system.num_output_ports()))
        return np.concatenate([output.Eval(context) for output in every])

    np.testing.assert_array_equal(outputs(beyond), outputs(bound))
