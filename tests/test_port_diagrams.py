"""Every `pydrake_system` block matches the ports of real systems."""

import dataclasses as dc
import importlib
import re
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder
from robot.drive.stand import FakeArm, FakeGripper, FakePlanner, kitchen

from drake_srg.common.systems import input_ports, output_ports
from drake_srg.gripper.joint_servos import PlantJointServos
from drake_srg.gripper.srg_position_driver import SrgPositionDriver
from drake_srg.gripper.srg_tendon_driver import TorqueControl
from drake_srg.gripper.tendon import TendonDriveConfig
from drake_srg.learning.cell_planner import OneShotPlanner, PolicyPlanner
from drake_srg.learning.envs.scenes import Workspace
from drake_srg.planning.state_machine import ModeActions, StateMachine
from drake_srg.robot.drive.opening import Hardware
from drake_srg.robot.drive.run import MakeHardwareCell
from drake_srg.robot.drive.station import MakeHardwareStation
from drake_srg.robot.serve.loop import MakeServedStation
from drake_srg.robot.twin.station import MakeTwin
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.recorders import AddRecorders
from drake_srg.station import MakeCell, MakeStation
from drake_srg.station.cameras import MakeRemoteCameras
from drake_srg.station.clearing import MakeClearingPair
from drake_srg.station.planners import MakeCarryPlanner, MakeHandoverPlanner
from drake_srg.station.servoing import MakeServoingPlanner
from drake_srg.station.video_process import RemoteVideoRecorder
from drake_srg.suite.cell import MakeDrivenCell
from drake_srg.types import Box
from drake_srg.vision.camera import CameraModel
from drake_srg.vision.height_map import HeightMapper
from drake_srg.vision.surfaces import Surface
from make_site.systems import find_blocks

pytestmark = pytest.mark.slow

# Together, these have at least one instance of every documented system.
CELLS = {
    "kitchen": [
        "disturbances=[!Push {}]",
        "sleeping={}",
        "safety={}",
        "camera_calibrations={ceiling: {}}",
    ],
    "kitchen_tendon": [],
    "kitchen_impedance": [],
    "insert": [],
    "kitchen_varied": [],
    "kitchen_varied_accurate": [],
    "clear_table": [],
    "sort_table": ["task.place.bins.red_bin=[red_can]"],
    "assistive_arm": [],
    "assistive_arm_varied": [],
    "assistive_arm_thesis": [],
    "learn_bench": [
        "gripper=!PlantServoDriver {underactuation: {evaluate: per_message}}",
        "arm.weightless=true",
        "arm.command_period=0.01171875",
    ],
    "thesis_kitchen": ["gripper.underactuation.evaluate=per_message"],
}
# One with an inset in its video, and one without.
RECORDED = ("kitchen", "clear_table")
SPONGE = (
    "objects={sponge: {shape: !Box {size: [0.1, 0.06, 0.04]}, soft: {}, mass: 0.01,"
    " friction: 1, position: [0, 0]}}"
)
SOFT = ["plant_config.discrete_contact_approximation=sap", "task.pick=sponge", SPONGE]

BLOCKS = find_blocks()


@dc.dataclass
class Port:
    """A documented port: `NAME (remark)`; words in capitals stand for any name."""

    pattern: str
    remark: str

    @classmethod
    def of(cls, text):
        name, _, remark = text.partition("(")
        return cls(name.strip(), remark.rstrip(")").strip())

    @property
    def conditional(self):
        """Whether some systems lack the port. Optional ports exist, unconnected."""
        return self.remark not in ("", "optional")

    def matches(self, name):
        pattern = re.sub(r"[A-Z]{2,}", "[a-z0-9_]+", re.escape(self.pattern))
        return re.fullmatch(pattern, name) is not None


def documented(ports):
    """The documented ports; `(all of the station's ...)` stands for the station's."""
    found = []
    for text in ports:
        if text.startswith("("):
            station = next(block for block in BLOCKS if block.name == "Station")
            both = [*station.input_ports, *station.output_ports]
            found += [Port(Port.of(p).pattern, "of the station") for p in both]
        else:
            found.append(Port.of(text))
    return found


def subsystems(system):
    yield system
    if isinstance(system, Diagram):
        for child in system.GetSystems():
            yield from subsystems(child)


class Waiting(ModeActions):
    def observe(self, memory, now):
        return None


def make_machine():
    """A state machine that stays in its only mode."""
    return StateMachine(
        {"waiting": Waiting()},
        initial="waiting",
        memory=None,
        transition=lambda mode, observation, t: mode,
        period=1.0,
    )


def hardware_systems():
    """The systems of a robot in place of the simulation, by name."""
    scenario = kitchen()
    cameras = {"ceiling": None}
    hardware = Hardware([FakeArm(), FakeGripper()], cameras, {})
    seeing = MakeHardwareStation(scenario, hardware)
    blind = MakeHardwareStation(scenario, dc.replace(hardware, cameras={}))
    cell = MakeHardwareCell(scenario, blind, FakePlanner(), 1.0)
    return {
        "HardwareStation": seeing,
        "HardwareReader": seeing.GetSubsystemByName("hardware_reader"),
        "HardwareWriter": seeing.GetSubsystemByName("hardware_writer"),
        "CommonStop": seeing.GetSubsystemByName("common_stop"),
        "HandHold": seeing.GetSubsystemByName("hand_hold"),
        "CameraFeed": seeing.GetSubsystemByName("camera_ceiling"),
        "HardwareCell": cell,
        "RemotePlanner": cell.GetSubsystemByName("planner"),
    }


def servoed_hardware_systems():
    """The systems of a robot with a visual servo, and their names."""
    scenario = load_scenario("kitchen_servoing")
    hardware = Hardware([FakeArm(), FakeGripper()], {}, {})
    station = MakeHardwareStation(scenario, hardware)
    cell = MakeHardwareCell(scenario, station, FakePlanner(), 1.0)
    yield "HardwareCell", cell
    for name in ("planner", "late_sightings"):
        system = cell.GetSubsystemByName(name)
        yield type(system).__name__, system


def served_systems():
    """The systems of a served station, and their names."""
    following = load_scenario("kitchen", overrides=["arm.limits=null"])
    served = MakeServedStation(following)
    yield "ServedStation", served
    yield "TrajectoryFollower", served.GetSubsystemByName("arm_reference")
    yield "ServedStation", MakeServedStation(load_scenario("kitchen"))
    yield "RemoteCameras", MakeRemoteCameras(load_scenario("kitchen"))
    for name in ("kitchen", "clear_table"):
        yield "DrivenCell", MakeDrivenCell(load_scenario(name))


def twin_systems():
    """The systems of a digital twin, and their names."""
    twin = MakeTwin(load_scenario("kitchen"))
    yield "Twin", twin
    for system in subsystems(twin):
        yield type(system).__name__, system


def servoed_planners():
    """The planner of a scenario with each of the visual servos."""
    for method in ("pbvs", "ibvs"):
        settings = [f"planner.servo.method={method}"]
        yield MakeServoingPlanner(load_scenario("kitchen_servoing", overrides=settings))


NO_GRIPPER = ["gripper=null"]
NO_GRIPPER += ["directives.gripper=null", "directives.gripper::palm=null"]


def recorders(name, *arguments):
    """The recorders of a cell, if it is one of those that are recorded."""
    return AddRecorders(*arguments).values() if name in RECORDED else ()


def sharing_systems():
    """Yield the systems of two arms that clear one table."""
    pair = MakeClearingPair(load_scenario("clear_table_together"))
    yield "ClearingPair", pair
    yield "SharingPlanner", pair.GetSubsystemByName("left")
    yield "JointStatus", pair.GetSubsystemByName("joint_status")


@pytest.fixture(scope="module")
def systems(tmp_path_factory):
    """Real systems by the names of the blocks that document them."""
    found = {}

    def add(name, system):
        found.setdefault(name, []).append(system)

    alive = []  # diagrams own their systems
    for name, overrides in CELLS.items():
        scenario = load_scenario(name, overrides=overrides)
        builder = DiagramBuilder()
        cell = builder.AddNamedSystem("cell", MakeCell(scenario))
        folder = tmp_path_factory.mktemp("recorded")
        for recorder in recorders(name, builder, cell, scenario, folder):
            add(type(recorder).__name__, recorder)
        alive.append(builder.Build())
        add("Cell", cell)
        station = cell.GetSubsystemByName("station")
        add("Station", station)
        driver = station.GetSubsystemByName("gripper_driver")
        add(type(scenario.gripper).__name__, driver)
        arm_driver = station.GetSubsystemByName("arm_driver")
        add("ArmDriver", arm_driver)
        if scenario.arm.command_period is not None:
            add("Interpolation", arm_driver.GetSubsystemByName("interpolator"))
        for system in subsystems(cell):
            add(type(system).__name__, system)
    for planner in servoed_planners():
        alive.append(planner)
        add("ServoedPlanner", planner)
        add("VisualServo", planner.GetSubsystemByName("servo"))
        for system in subsystems(planner):
            add(type(system).__name__, system)
    kitchen = load_scenario("kitchen")
    bare = load_scenario("kitchen", overrides=NO_GRIPPER)
    armed = MakeStation(dc.replace(bare, cameras={}))
    add("Station", armed)
    add("ArmDriver", armed.GetSubsystemByName("arm_driver"))
    add("Station", MakeStation(Scenario()))
    soft = MakeStation(load_scenario("gripper_bench", overrides=SOFT))
    add("ObjectPoses", soft.GetSubsystemByName("object_poses"))
    process = SimpleNamespace(send=lambda *message: None, finish=lambda _: 0)
    folder = tmp_path_factory.mktemp("video")
    video = RemoteVideoRecorder(process, folder / "video.mp4", 3, 20.0)
    add("RemoteVideoRecorder", video)
    camera = CameraModel.from_config(kitchen.cameras["ceiling"])
    add("HeightMapper", HeightMapper({"ceiling": camera}, Surface((0, 0), (1, 1), 0)))
    add("StateMachine", make_machine())
    add("TorqueControl", TorqueControl(TendonDriveConfig(), 0.005))
    add("PlantJointServos", PlantJointServos(SrgPositionDriver().servo))
    still = SimpleNamespace(pose=lambda q: q)
    box = Box([0.05, 0.05, 0.1])
    hand = (np.tanh, still, np.zeros(4), "box", box, 0.0)
    add("PolicyPlanner", PolicyPlanner(*hand, workspace=Workspace.of(kitchen)))
    add("OneShotPlanner", OneShotPlanner(*hand))
    for name, system in [
        ("HandoverPlanner", MakeHandoverPlanner(load_scenario("handover"))),
        ("CarryPlanner", MakeCarryPlanner(load_scenario("carry_together"))),
        *sharing_systems(),
        *served_systems(),
        *hardware_systems().items(),
        *servoed_hardware_systems(),
        *twin_systems(),
    ]:
        add(name, system)
    yield found
    for recorder in [*found["VideoRecorder"], *found["RosbagRecorder"]]:
        recorder.__exit__(None, None, None)


def instances(systems, block):
    """Systems of a block: by its class, or, of a function, by its diagram's name."""
    return [
        system
        for system in systems.get(block.owner, []) or systems.get(block.name, [])
        if type(system) is Diagram or "drake_srg" in type(system).__module__
    ]


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_a_block_names_the_real_ports(systems, block):
    made = instances(systems, block)
    assert made, f"add a {block.name} to the systems of this test"
    for list_ports, texts in (
        (input_ports, block.input_ports),
        (output_ports, block.output_ports),
    ):
        if block.name == "RosbagRecorder":
            continue  # its ports are its topics': tests/recording/test_rosbag.py
        ports = documented(texts)
        everywhere = [set(list_ports(system)) for system in made]
        for names in everywhere:
            undocumented = {n for n in names if not any(p.matches(n) for p in ports)}
            assert undocumented == set()
        for port in ports:
            exists = [any(port.matches(n) for n in names) for names in everywhere]
            if port.conditional:
                assert any(exists) or port.remark == "of the station", port
            else:
                assert all(exists), port


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_a_block_documents_something_of_its_module(block):
    assert hasattr(importlib.import_module(block.module), block.owner)


def test_there_are_blocks():
    assert len(BLOCKS) >= 35


def test_a_missing_and_an_unknown_port_are_found():
    assert Port.of("camera_NAME.color_image").matches("camera_ceiling.color_image")
    assert not Port.of("camera_NAME.color_image").matches("camera_ceiling.depth_image")
    assert not Port.of("pwm").matches("pwms")
    assert not Port.of("hold (optional)").conditional
    assert Port.of("wire_force (SrgTendonDriver)").conditional
    assert Port.of("force (optional; SrgTendonDriver)").conditional
