"""A fake world for the planner, in which all goes well unless a test changes it."""

import numpy as np
from helpers import fix
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.trajectories import PiecewisePolynomial

from drake_srg.lifetime import LeafSystem
from drake_srg.planning.grasps.srg_hand import SrgHand
from drake_srg.planning.pick_and_place.planner import PickAndPlacePlanner
from drake_srg.planning.pick_and_place.sightings import PickTask
from drake_srg.planning.pick_and_place.task_motions import TaskMotions
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import Blob, Cylinder, Mode

CAN, CUP = Cylinder(0.034, 0.1), Cylinder(0.04, 0.09)
START, GOAL = np.array([0.6, 0.1, 0.05]), np.array([0.5, -0.4, 0.05])
MOVING = [
    *(Mode.PRE_GRASP, Mode.GRASP, Mode.LIFT, Mode.TRANSFER, Mode.PLACE),
    *(Mode.RETREAT, Mode.HOME),
]
# Of pick-and-place, in the order of a cycle.
MODES = [mode for mode in Mode if mode is not Mode.PUSH]
CYCLE = [mode for mode in MODES if mode is not Mode.FAILED]
_CLOSED = [Mode.CLOSE, Mode.VERIFY, Mode.LIFT, Mode.TRANSFER, Mode.PLACE]


def blob(position, name="can", quality=0.9, axis=(0.0, 0.0, 1.0)):
    X_WO = RigidTransform(RotationMatrix.MakeFromOneVector(axis, 2), position)
    return Blob(name, "eye", (1.0, 2.0), X_WO, quality)


def motion(start, end):
    """Return a motion from one posture to another in 0.1 s."""
    return PiecewisePolynomial.FirstOrderHold([0.0, 0.1], np.column_stack([start, end]))


class FakeScene:
    """A scene whose hand is as far out [m] as the first joint is turned [rad]."""

    def X_WG(self, q):  # as in PlanningScene
        return RigidTransform([q[0], 0.0, 0.0])


class FakeTaskPlanner:
    """Plans for a two-joint arm: 1 rad out and back, mode by mode, then home."""

    def __init__(self):
        self.q_home = np.array([0.5, -0.5])
        self.scene = FakeScene()
        self.hand = SrgHand(["above"], [], 0.4)
        self.grasp = self.hand.grasps(CAN, RigidTransform())[0]
        self.result = self.escape = self.place = None  # failures, in place of motions
        self.hit = None  # what is in the way
        self.calls, self.places = [], []

    def X_WG(self, q):
        return self.scene.X_WG(q)

    def plan(self, q_start, X_WO, shape, X_WO_goal, obstacles=(), tried=()):
        self.calls.append((q_start, X_WO, shape, X_WO_goal, tuple(obstacles), tried))
        self.obstacles = obstacles
        if self.result is not None:
            return self.result
        return self._motions(q_start, MOVING)

    def plan_place(self, q_start, grasp, shape, X_WO_goal, obstacles=()):
        self.places.append((q_start, grasp, shape, X_WO_goal))
        self.obstacles = obstacles
        if self.place is not None:
            return self.place
        return self._motions(q_start, MOVING[MOVING.index(Mode.PLACE) :])

    def rests(self, shape, X_WO):
        return X_WO.translation()[2] >= 0.04

    def others(self, q, fingers, obstacles):
        return tuple(obstacles)

    def obstruction(self, task, shape, obstacles):
        self.checked = list(task.motions)
        return self.hit if obstacles else None

    def _motions(self, q_start, modes):
        n = len(modes)
        q = [q_start + np.array([min(i, n - i), 0.0]) for i in range(n)] + [self.q_home]
        return TaskMotions(
            self.grasp, {m: motion(q[i], q[i + 1]) for i, m in enumerate(modes)}
        )

    def plan_escape(self, q, fingers, obstacles=()):
        self.fingers = fingers
        if self.escape is not None:
            return self.escape
        middle = 0.5 * (q + self.q_home)
        return motion(q, middle), motion(middle, self.q_home)


def make_planner(task_planner=None, repeat=1, **config):
    return PickAndPlacePlanner(
        task_planner or FakeTaskPlanner(),
        PickTask(
            "can", CAN, RigidTransform(GOAL), obstacles={"cup": CUP}, repeat=repeat
        ),
        PlannerConfig(**config),
    )


class Camera(LeafSystem):
    """Shows given blobs, and counts its evaluations."""

    def __init__(self):
        super().__init__()
        self.blobs = list
        self.evaluations = 0
        self.DeclareAbstractOutputPort(
            name="blobs", alloc=lambda: AbstractValue.Make([]), calc=self._look
        )
        self.obstacles = list
        self.DeclareAbstractOutputPort(
            name="obstacles",
            alloc=lambda: AbstractValue.Make([]),
            calc=lambda context, output: output.set_value(self.obstacles()),
        )

    def _look(self, context, output):
        self.evaluations += 1
        output.set_value(self.blobs())


class World:
    """A planner between a camera, an arm that follows and fingers that hold.

    Tests replace `where` (the blobs seen in a mode), `unknown` (the obstacles seen in a
    mode), `holding` (whether the fingers hold something in a mode), `base_angle` (of
    the fingers in a mode [rad]), `external_torque` (on the arm in a mode [N m]; None
    leaves the port unconnected) and `arm_follows`.

    Args:
        like: A world whose systems this one shares.
        start: Time at which the simulation begins [s].
        config: Configuration of the planner.
    """

    def __init__(self, *, like=None, start=0.0, **config):
        if like is None:
            builder = DiagramBuilder()
            self.camera = builder.AddSystem(Camera())
            self.task_planner = FakeTaskPlanner()
            self.planner = builder.AddSystem(make_planner(self.task_planner, **config))
            for name in ("blobs", "obstacles"):
                builder.Connect(
                    self.camera.GetOutputPort(name), self.planner.GetInputPort(name)
                )
            self.diagram = builder.Build()
        else:
            self.diagram, self.camera = like.diagram, like.camera
            self.planner, self.task_planner = like.planner, like.task_planner
        self.period = self.planner.config.period
        self._simulator = Simulator(self.diagram)
        self.root = root = self._simulator.get_mutable_context()
        root.SetTime(start)
        self._start = start
        self._context = self.planner.GetMyMutableContextFromRoot(root)
        self.seen, self.trace, self.commands = [], [], []
        self.began, self.closures = {}, {}
        self.where = lambda mode: [blob(GOAL if mode is Mode.HOME else START)]
        self.unknown = lambda mode: []
        self.holding = lambda mode: True
        self.base_angle = lambda mode: self.task_planner.grasp.base_angle
        self.external_torque = None
        self.arm_follows = True

    @property
    def status(self):
        return self.planner.GetOutputPort("status").Eval(self._context)

    @property
    def time(self):
        return self._context.get_time() - self._start

    def show(self, look, modes=(), after=None):
        """Let the camera show `look()` in some modes, or after a mode until home."""
        usual = self.where

        def shown(mode):
            later = after in self.trace and mode is not Mode.HOME
            return look() if mode in modes or later else usual(mode)

        self.where = shown

    def held(self, shift=(0.0, 0.0, 0.0), sign=1.0):
        """Return the blob of an object in the hand, shifted in the hand's frame [m]."""
        grasp = self.task_planner.grasp
        X_WG = self.task_planner.scene.X_WG(self.commands[-1])
        return blob(X_WG @ (grasp.p_GO + shift), axis=sign * grasp.axis_G)

    def run(self, limit=60.0):
        """Let time pass until the planner has ended; return its status."""
        self.camera.blobs = self._look
        self.camera.obstacles = lambda: self.unknown(self.status.mode)
        self._sense()
        while self.time < limit:
            self._simulator.AdvancePendingEvents()
            status = self.status
            if status.mode not in self.trace[-1:]:
                self.trace.append(status.mode)
                self.began.setdefault(status.mode, self.time)
            self.closures[status.mode] = self.read("closure_commanded")[0]
            self.commands.append(self.read("position_commanded"))
            if status.mode in (Mode.DONE, Mode.FAILED):
                return status
            self._sense()
            self._simulator.AdvanceTo(self._start + self.time + self.period)
        raise AssertionError(f"still {status} after {limit} s")

    def fail(self, failure, words=""):
        """Let time pass until the planner gives up, for a reason; return its status."""
        status = self.run()
        assert (status.mode, status.failure) == (Mode.FAILED, failure)
        assert words in status.message
        return status

    def read(self, name):
        return self.planner.GetOutputPort(name).Eval(self._context).copy()

    def _look(self):
        blobs = self.where(self.status.mode)
        self.seen += blobs
        return blobs

    def _sense(self):
        mode = self.status.mode
        held = self.holding(mode) and mode in _CLOSED
        q = self.read("position_commanded") if self.arm_follows else [9.0, 9.0]
        base = [self.base_angle(mode)] * 2
        fix(
            self.planner,
            self._context,
            arm_state=[*q, 0.0, 0.0],
            gripper_state=[*base, 0, 0, 0, 0, 0, 0],
            grasped=float(held),
            proximity=[0.0 if held else 0.05] * 4,
        )
        if self.external_torque is not None:
            torque = self.external_torque(mode)
            fix(self.planner, self._context, external_torque=torque)
