"""Sweeps with recordings of known signals, made by our recorder."""

import functools
import json

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from drake_srg.lifetime import LeafSystem
from drake_srg.recording.camera_topics import calibration_topics
from drake_srg.recording.rosbag import (
    ArmNames,
    RosbagRecorder,
    cell_topics,
    finger_topics,
)
from drake_srg.scenario import RobotArm
from drake_srg.sweeps.rows import row_path, write_row
from drake_srg.sweeps.trial import empty_row
from drake_srg.types import Blob, Mode, PlannerStatus
from drake_srg.vision.camera import CameraModel

ARM, GRIPPER = ["a1", "a2"], ["left_base", "right_base"]
SLOPE = np.array([1.0, -2.0, 0.3, 0.4])  # of the joints [rad/s]
STEP = 0.1  # time between steps of the commanded closure [s]


def joint_positions(time):
    """Return the positions of all joints; linear, so that interpolation is exact."""
    return 0.5 + SLOPE * time


def closure(time):
    return np.floor(time / STEP + 1e-9) / 100


SEEN = 0.3  # when the planner first sees the object [s]


def seen_pose(time):
    """Return where the planner last saw the object; it looks five times a second."""
    looked = np.floor(time / 0.2 + 1e-9) * 0.2
    return RigidTransform(RollPitchYaw(0.0, 0.1, looked), [0.5, 0.1 * looked, 0.05])


class Status(LeafSystem):
    """Outputs the status of a planner."""

    def __init__(self):
        super().__init__()
        self.DeclareAbstractOutputPort(
            "status", lambda: AbstractValue.Make(PlannerStatus()), self.calc
        )

    def calc(self, context, output):
        time = context.get_time()
        if time < SEEN - 1e-9:
            return output.set_value(PlannerStatus())
        blob = Blob("soup_can", "ceiling", (0.0, 0.0), seen_pose(time), 1.0)
        return output.set_value(PlannerStatus(sighting=blob, sighted_at=time))


class Signal(LeafSystem):
    """Outputs a function of time as a vector."""

    def __init__(self, function):
        super().__init__()
        self.function = function
        self.DeclareVectorOutputPort("y", np.size(function(0.0)), self.calc)

    def calc(self, context, output):
        output.SetFromVector(np.atleast_1d(self.function(context.get_time())))


def picture(time, width, height, shade):
    """Return an RGB image of a disc that moves over a gradient."""
    y, x = np.mgrid[:height, :width]
    image = np.empty((height, width, 3), dtype=np.uint8)
    image[..., 0] = 255 * x // width
    image[..., 1] = 255 * y // height
    image[..., 2] = shade
    image[(x - 20 - 20 * time) ** 2 + (y - height / 2) ** 2 < 15**2] = (240, 240, 40)
    return image


def depth_picture(time, width, height):
    """Return depths [m]: a slope, a disc that moves, and pixels without depth."""
    y, x = np.mgrid[:height, :width]
    depth = 0.4 + (y * width + x) * 0.001
    depth[(x - 20 - 20 * time) ** 2 + (y - height / 2) ** 2 < 15**2] = 0.3
    depth[:, 0] = np.inf
    depth[0] = 0.0
    return depth.astype(np.float32)


def camera_pose(time):
    """Return the pose of the camera that moves, with its calibration's error."""
    return RigidTransform(RollPitchYaw(3.0, 0.0, 0.1 * time), [0.5, 0.0, 1.0 + time])


def effort(time):
    """Return the torques of the arm's joints [N m]."""
    return np.array([3.0, -2.0 * time])


def touch(time):
    """Return the normal forces of the fingers' links [N]."""
    return np.array([10.0 * time, 0.0])


def contact_wrench(time):
    """Return the wrenches on the fingers' links: torque [N m], force [N]."""
    return np.arange(12) * (time - 0.5)


def grasped(time):
    return float(time > 0.4)


MODES = ((0.0, Mode.IDLE), (0.2, Mode.PRE_GRASP), (0.6, Mode.GRASP))


def mode(time):
    return [mode for start, mode in MODES if time >= start - 1e-9][-1]


class Abstract(LeafSystem):
    """Outputs a function of time as an abstract value."""

    def __init__(self, function):
        super().__init__()
        self.function = function
        self.DeclareAbstractOutputPort(
            "y", lambda: AbstractValue.Make(function(0.0)), self.calc
        )

    def calc(self, context, output):
        output.set_value(self.function(context.get_time()))


def depth_image(time, width, height):
    image = ImageDepth32F(width, height)
    image.mutable_data[..., 0] = depth_picture(time, width, height)
    return image


class Camera(LeafSystem):
    def __init__(self, width, height, shade):
        super().__init__()
        self.size, self.shade = (width, height), shade
        self.DeclareAbstractOutputPort(
            "color_image", lambda: AbstractValue.Make(ImageRgba8U()), self.calc
        )

    def calc(self, context, output):
        made = ImageRgba8U(*self.size)
        made.mutable_data[..., :3] = picture(context.get_time(), *self.size, self.shade)
        output.set_value(made)


def record(
    path,
    until,
    *,
    cameras,
    shade=0,
    image_period=0.125,
    period=0.025,
    located=True,
    rich=(),
    sensors=2,
    arms=("",),
):
    """Record a trial of `until` seconds; `cameras` maps names to (width, height).

    Those of `rich` have calibrations and depth, and with any, the arm measures torque
    and the hand wrenches. Of several `arms`, the signals of the second are twice those
    of the first, and so on.
    """
    periods = dict.fromkeys(cameras, image_period)
    robots = [RobotArm(name) for name in arms]
    names = [
        ArmNames(
            [*map(robot.system, ARM)],
            [*map(robot.system, GRIPPER)],
            sensors,
            robot.arm_model,
            robot.gripper_model,
        )
        for robot in robots
    ]
    topics = cell_topics(names, periods, located=located)
    sources = {"planner.mode": Abstract(mode)}
    for scale, robot in enumerate(robots, 1):
        arm, hand = robot.arm_model, robot.gripper_model
        signals = {
            f"{arm}.state_measured": lambda t: np.r_[joint_positions(t)[:2], 0.0, 0.0],
            f"{hand}.state_measured": lambda t: np.r_[joint_positions(t)[2:], 0.0, 0.0],
            f"{arm}.position_commanded": lambda t: joint_positions(t)[:2] + 0.01,
            f"{hand}.closure_commanded": closure,
            f"{hand}.proximity": lambda t: np.full(sensors, 0.01),
            f"{hand}.contact_force": lambda t: np.resize(touch(t), sensors),
        }
        if rich:
            signals[f"{arm}.torque_measured"] = effort
            signals[f"{hand}.contact_wrench"] = contact_wrench
            signals[f"{hand}.grasped"] = grasped
            topics += finger_topics(hand, dict(zip(GRIPPER, GRIPPER, strict=True)))
        for name, function in signals.items():
            sources[name] = Signal(lambda t, f=function, k=scale: k * np.asarray(f(t)))
    for name in rich:
        width, height = cameras[name]
        info = CameraInfo(width, height, 100.0, 101.0, 80.5, 64.5)
        model = CameraModel(info)
        topics += calibration_topics(name, model, image_period, depth=True)
        image = functools.partial(depth_image, width=width, height=height)
        sources[f"camera_{name}.depth_image"] = Abstract(image)
        sources[f"camera_{name}.body_pose_in_world"] = Abstract(camera_pose)
    if located:
        sources["planner.status"] = Status()
    for name, size in cameras.items():
        sources[f"camera_{name}.color_image"] = Camera(*size, shade)
    builder = DiagramBuilder()
    recorder = builder.AddSystem(RosbagRecorder(path, topics, period=period))
    for name, source in sources.items():
        builder.AddSystem(source)
        if recorder.HasInputPort(name):
            builder.Connect(source.get_output_port(), recorder.GetInputPort(name))
    with recorder:
        Simulator(builder.Build()).AdvanceTo(until)


CAMERAS = {"ceiling": (160, 128), "side": (131, 129)}  # one has an odd size


def write_trial(sweep, trial, until, *, failure=None, cameras=None, **how):
    """Write recording and row of a trial, like `drake-srg sweep --record all`."""
    folder = sweep / "recordings" / f"{trial:06d}"
    cameras = CAMERAS if cameras is None else cameras
    record(folder / "recording.mcap", until, cameras=cameras, shade=9 * trial, **how)
    metrics = {"seed": 100 + trial, "success": failure is None, "failure": failure}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    row = {**empty_row(100, trial, ""), **metrics}
    write_row(row_path(sweep, trial), row)


def write_sweep(folder):
    """Write the folder of a sweep without any recordings."""
    folder.mkdir(parents=True, exist_ok=True)
    about = {
        "schema_version": 1,
        "scenario": "kitchen_varied",
        "seed": 100,
        "trials": 9,
        "record": "all",
        "overrides": [],
        "tree": "task:\n  pick: soup_can\n",
        "versions": {},
    }
    (folder / "sweep.json").write_text(json.dumps(about))
    return folder
