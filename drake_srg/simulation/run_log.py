"""The log of a run, and its samples for log and replay."""

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydrake.systems.framework import Context, Diagram, OutputPort, PortDataType

from drake_srg.common.log_format import MODES, mode_columns, pose_key, pose_to_row
from drake_srg.common.systems import output_ports
from drake_srg.lifetime import my_context
from drake_srg.objects.poses import ContactReader
from drake_srg.planning.carrying.config import CarryTogether
from drake_srg.recording.recording import SignalLog, write_samples
from drake_srg.recording.replay import ReplayRecorder
from drake_srg.scenario import RobotArm, Scenario, robot_arms
from drake_srg.simulation.between_arms import (
    ARM_CONTACT,
    INTERNAL_FORCE,
    ArmContacts,
    InternalForce,
)
from drake_srg.simulation.measures import AT_REST, final_speed
from drake_srg.simulation.recorders import run_labels
from drake_srg.types import Mode

_ARM = (
    *("state_measured", "state_cheat", "torque_measured"),
    *("external_torque", "position_commanded"),
)
_GRIPPER = ("state_measured", "closure_commanded", "pwm", "proximity", "grasped")
_SAFETY = ("state", "speed_scale")
_TWIN = (
    "twin.difference",
    "twin.parted",
    "twin.joint_error",
    "twin.finger_error",
    "twin.object_error",
    "twin.torque_expected",
    "twin.torque_residual",
)
# All other vector ports of a gripper are logged, such as those of your own finger
# sensors, except these. (`Rig` logs these, too.)
_NOT_LOGGED = (
    *("contact_force", "contact_wrench"),
    *("motor_state", "wire_force", "motor_temperature"),
)


def _logged(robots: Sequence[RobotArm], ports: Mapping[str, OutputPort]) -> list[str]:
    """Return the names of the vector ports to log."""
    named, others = [], []
    for robot in robots:
        gripper = f"{robot.gripper_model}."
        named += [f"{robot.arm_model}.{name}" for name in _ARM]
        named += [f"{gripper}{name}" for name in _GRIPPER]
        named += [f"{robot.prefix}safety.{name}" for name in _SAFETY]
        others += [
            name
            for name, port in ports.items()
            if name.startswith(gripper)
            and name.removeprefix(gripper) not in (*_GRIPPER, *_NOT_LOGGED)
            and port.get_data_type() == PortDataType.kVectorValued
        ]
    named += ["hole_force_cheat", *_TWIN]
    return [name for name in named if name in ports] + others


def merged(forces: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the largest force under each name [N]."""
    names = dict.fromkeys(name for each in forces for name in each)
    return {n: max(each[n] for each in forces if n in each) for n in names}


def _carriers(scenario: Scenario) -> tuple[str, str] | None:
    """Return the two grippers that carry one object together, or None."""
    planner = scenario.planner
    if not isinstance(planner, CarryTogether):
        return None
    models = {robot.name: robot.gripper_model for robot in robot_arms(scenario)}
    return models[planner.first], models[planner.second]


class RunLog(SignalLog):
    """Samples a cell's ports, the poses of objects and the grip force during a run.

    Args:
        scenario: The scenario of the run.
        cell: A cell with the ports of `MakeCell`, or a station, whose mode is logged as
            idle. Ports that it lacks are not logged: on hardware, those of object poses
            and contact forces.

    Attributes:
        touching: Names of the bodies that touched the picked object in the latest
            sample in which it did not sleep, as in `ContactReader.forces`.
    """

    def __init__(self, scenario: Scenario, cell: Diagram) -> None:
        ports = output_ports(cell)
        self._robots = robots = robot_arms(scenario)
        super().__init__({name: ports[name] for name in _logged(robots, ports)})
        self._arms = [robot.arm_model for robot in robots]
        self._grippers = [robot.gripper_model for robot in robots]
        self._mode = ports.get("planner.mode")
        modes = {f"{arm.prefix}mode": f"planner.{arm.prefix}mode" for arm in robots}
        self._own_modes = {
            name: ports[port]
            for name, port in modes.items()
            if port in ports and name != "mode"
        }
        self._poses = ports.get("object_poses_cheat")
        self._contacts = ports.get("contact_results_cheat")
        self._asleep = ports.get("objects_asleep_cheat")
        self._pick, clear = scenario.task.pick, scenario.task.clear
        # With several objects to pick, the grippers' contacts are read.
        self._grasped = frozenset(() if clear is None else clear.objects)
        self._readers: list[ContactReader] = []
        self._between: ArmContacts | None = None
        self._carriers = _carriers(scenario)
        self._internal: InternalForce | None = None
        picked = scenario.objects.get(self._pick) if self._pick else None
        self._present = picked is not None and picked.present
        self.touching: set[str] = set()

    def row(self, context: Context) -> dict[str, Any]:
        """Return the values of all columns; `arrays` turns the mode into columns."""
        row = super().row(context)
        row["mode"] = Mode.IDLE if self._mode is None else self._mode.Eval(context)
        for name, port in self._own_modes.items():
            row[name] = float(MODES.index(port.Eval(context)))
        if self._poses is not None:
            for name, X_WO in self._poses.Eval(context).items():
                row[pose_key(name)] = pose_to_row(X_WO)
        if self._contacts is not None:
            self._sample_contacts(self._contacts, context, row)
        return row

    def _sample_contacts(
        self, port: OutputPort, context: Context, row: dict[str, Any]
    ) -> None:
        forces = {}
        if self._present or self._grasped:
            contacts = port.Eval(context)
            if not self._readers:
                robots = (*self._arms, *self._grippers)
                self._readers = [
                    ContactReader(contacts.plant(), whose, robots)
                    for whose in (self._grippers if self._grasped else [self._pick])
                ]
            forces = merged([reader.forces(contacts) for reader in self._readers])
        if len(self._arms) > 1:
            contacts = port.Eval(context)
            if self._between is None:
                self._between = ArmContacts(contacts.plant(), self._robots)
            row[ARM_CONTACT] = self._between.force(contacts)
        if self._carriers and self._present:
            contacts = port.Eval(context)
            if self._internal is None:
                self._internal = InternalForce(
                    contacts.plant(), self._pick, self._carriers
                )
            row[INTERNAL_FORCE] = self._internal.force(contacts)
        pressing = self._grasped if self._grasped else self._grippers
        row["contact_force"] = max(
            (forces[name] for name in forces if name in pressing), default=0.0
        )
        if self._asleep is None or self._pick not in self._asleep.Eval(context):
            self.touching = set(forces)

    @property
    def clearing_moves(self) -> bool:
        """Whether an object that is to be cleared is moving."""
        time = np.array([row["time"] for row in self._rows])
        return any(
            final_speed(time, np.array([row[name] for row in self._rows])) >= AT_REST
            for name in (pose_key(name) for name in self._grasped)
            if name in self._rows[-1]
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return one array per quantity, with one row per sample."""
        modes = mode_columns([row["mode"] for row in self._rows])
        return super().arrays() | modes


class Samples:
    """The samples of a run, for its log and replay.

    Args:
        name: Name of the scenario.
        scenario: The scenario of the run.
        root: The root diagram.
        cell: The cell in the root diagram.
        replayed: Whether to sample the scene for a replay, too.

    Attributes:
        log: The log.
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        root: Diagram,
        cell: Diagram,
        replayed: bool,
    ) -> None:
        self._name, self._scenario, self._cell = name, scenario, cell
        self.log = RunLog(scenario, cell)
        self._replay = None
        if replayed:
            cameras = scenario.localizer.cameras
            self._replay = ReplayRecorder(root, cell, scenario.objects, cameras)

    def add(self, root: Context) -> None:
        """Add a sample, at the time of the root diagram's context."""
        self.log.sample(my_context(self._cell, root))
        if self._replay is not None:
            self._replay.sample(root)

    def write(self, out: Path) -> dict[str, Path]:
        """Write the samples, if any; return the paths by kind (see `FILES`).

        Raises:
            OSError: If a file cannot be written.
        """
        if not self.log:
            return {}
        labels = run_labels(self._name, self._scenario)
        write_glb = None
        if self._replay is not None:
            config = self._scenario.recording
            write_glb = functools.partial(
                self._replay.write,
                labels=labels,
                video_camera=config.video_camera,
                video_start=1.0 / config.video_fps if config.video_camera else 0.0,
            )
        return write_samples(out, self.log.arrays(), labels, write_glb)
