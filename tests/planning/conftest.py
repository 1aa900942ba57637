"""Arms to plan for: an iiwa with the SRG on a table, a pendulum, the kitchen's arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.planning import RobotDiagramBuilder

from drake_srg.parsing import configure_parser
from drake_srg.planning.motion.inverse_kinematics import (
    HandTarget,
    solve_inverse_kinematics,
)
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.planning.pick_and_place.task_motions import TaskMotions, TaskPlanner
from drake_srg.scenario import load_scenario
from drake_srg.station import MakeTaskPlanner
from drake_srg.types import Box
from planning.pick_and_place.kitchen_task import GOAL, START
from planning.planning_world import CAN

_IIWA = """
directives:
- add_model: {name: table, file: package://drake_srg/sdf/table.sdf}
- add_model: {name: arm, file: package://drake_srg/sdf/iiwa14.sdf}
- add_weld: {parent: table::table_top, child: arm::link_0}
- add_model: {name: gripper, file: package://drake_srg/sdf/srg.sdf}
- add_weld:
    parent: arm::flange
    child: gripper::palm
    X_PC: {rotation: !Rpy {deg: [0, -90, 0]}}
"""

# Two hinges about y, an arm of almost no mass, 2 kg at 0.5 m: 9.81 N m when level.
_PENDULUM = """
<robot name="{name}">{body}</robot>
"""
_PENDULUM_ARM = """
<link name="base"/>
<link name="upper"><inertial><mass value="1e-3"/>
  <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><mass value="1e-3"/>
  <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
  <axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" velocity="2" effort="13" drake:acceleration="10"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
  <origin xyz="0.25 0 0"/><axis xyz="0 1 0"/>
  <limit velocity="3" effort="13" drake:acceleration="20"/></joint>
<transmission><type>SimpleTransmission</type><joint name="shoulder">
  <hardwareInterface>E</hardwareInterface></joint><actuator name="s"/></transmission>
<transmission><type>SimpleTransmission</type><joint name="elbow">
  <hardwareInterface>E</hardwareInterface></joint><actuator name="e"/></transmission>
"""
_PENDULUM_HAND = """
<link name="palm"><inertial><mass value="2"/>
  <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
"""


@pytest.fixture(scope="session")
def iiwa() -> PlanningScene:
    builder = RobotDiagramBuilder(time_step=0.0)
    configure_parser(builder.parser())
    builder.parser().AddModelsFromString(_IIWA, "dmd.yaml")
    return PlanningScene(builder)


def MakePendulum(payload: float = 0.0) -> PlanningScene:
    builder = RobotDiagramBuilder(time_step=0.0)
    plant, parser = builder.plant(), builder.parser()
    for name, body in (("arm", _PENDULUM_ARM), ("gripper", _PENDULUM_HAND)):
        parser.AddModelsFromString(_PENDULUM.format(name=name, body=body), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    elbow = plant.GetFrameByName("lower")
    hand = plant.GetFrameByName("palm")
    plant.WeldFrames(elbow, hand, RigidTransform([0.25, 0.0, 0.0]))
    return PlanningScene(builder, payload=payload)


@pytest.fixture(scope="session")
def pendulum() -> PlanningScene:
    return MakePendulum()


@pytest.fixture(scope="session")
def loaded_pendulum() -> PlanningScene:
    return MakePendulum(payload=0.5)


@pytest.fixture
def home() -> np.ndarray:
    """Return a posture with the elbow up and the hand down, clear of the table."""
    return np.array([0.0, -0.1, 0.0, -1.9, 0.0, 1.3, 0.0])


@pytest.fixture(scope="session")
def sides(iiwa: PlanningScene) -> list[np.ndarray]:
    """Return postures left and right of a wall at y = 0."""
    home = np.array([0.0, -0.1, 0.0, -1.9, 0.0, 1.3, 0.0])
    down = RotationMatrix(
        np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    )
    return [
        solve_inverse_kinematics(
            iiwa, HandTarget(np.array([0.55, y, 0.3]), down), q_nominal=home
        ).q
        for y in (-0.3, 0.3)
    ]


@pytest.fixture
def wall(iiwa: PlanningScene) -> Iterator[None]:
    """Let a wall stand between these postures."""
    with iiwa.standing(Box((0.3, 0.03, 0.5)), RigidTransform([0.6, 0.0, 0.25])):
        yield


@pytest.fixture(scope="session")
def planner() -> TaskPlanner:
    """Make the kitchen's task planner."""
    return MakeTaskPlanner(load_scenario("kitchen"))


@pytest.fixture(scope="session")
def task(planner: TaskPlanner) -> TaskMotions:
    """Plan from where the kitchen's can stands to its mark."""
    motions = planner.plan(planner.q_home, START, CAN, GOAL)
    assert isinstance(motions, TaskMotions)
    return motions
