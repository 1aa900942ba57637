"""The environments: GraspOneShot, Pick and PickPlace."""

from __future__ import annotations

import dataclasses as dc
from typing import Any, ClassVar

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.envs.episode_station import SimulationError
from drake_srg.learning.envs.hand_env import HandEnv, State, Step, checked, clipped
from drake_srg.learning.envs.hand_task import ObjectLostError
from drake_srg.learning.envs.rewards import LIFTED, Truth
from drake_srg.learning.envs.scenes import LOWEST, START_HEIGHT, Scene
from drake_srg.types import Cylinder, Shape, Vector

# Control periods of each part of the grasp: 0.75 s down, 0.75 s to close, 0.56 s up.
DOWN, CLOSE, UP = 16, 16, 12
REACH = 0.04  # largest distance from the estimated position [m]
HEIGHTS = (LOWEST, 0.115)  # of the grasp centre above the table [m]
MOST_PRESHAPE = 0.45
_ACROSS = np.deg2rad(80.0)  # turn beyond which a grasp counts as across


@dc.dataclass(frozen=True, eq=False)
class Grasp:
    """Meaning of an action of `GraspOneShotEnv`.

    Attributes:
        over: Pose of the hand (4) above the grasp, [x, y, z, yaw] [m, rad].
        at: Pose at which it closes.
        up: Pose to which it lifts.
        preshape: Closure on the way down, 0 .. 1.
        closure: Closure of the grasp.
    """

    over: Vector
    at: Vector
    up: Vector
    preshape: float
    closure: float


def grasp_of(action: Any, estimate: Vector, table: float) -> Grasp:
    """Return the grasp that an action of `GraspOneShotEnv` stands for.

    Args:
        action: Shape (6,).
        estimate: Estimate of the object, [x, y, z, yaw], shape (4,) [m, rad].
        table: Height of the table [m].
    """
    a = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
    height = HEIGHTS[0] + 0.5 * (a[2] + 1.0) * (HEIGHTS[1] - HEIGHTS[0])
    xy, yaw = estimate[:2] + REACH * a[:2], estimate[3] + a[3] * 0.5 * np.pi
    at = np.array([*xy, table + height, yaw])
    return Grasp(
        over=np.array([*xy, table + START_HEIGHT, yaw]),
        at=at,
        up=at + np.array([0.0, 0.0, LIFTED + 0.02, 0.0]),
        preshape=MOST_PRESHAPE * 0.5 * (a[4] + 1.0),
        closure=0.5 * (a[5] + 1.0),
    )


def action_of(
    at: Vector, preshape: float, closure: float, estimate: Vector, table: float
) -> State:
    """Return the action of a grasp: the inverse of `grasp_of`.

    The hand looks the same after half a turn, so every yaw has an action. An entry
    beyond -1 .. 1 means that the grasp is outside the environment's range.

    Args:
        at: Pose at which the hand closes, [x, y, z, yaw], shape (4,) [m, rad].
        preshape: Closure on the way there, 0 .. 1.
        closure: Closure of the grasp.
        estimate: Estimate of the object, [x, y, z, yaw], shape (4,) [m, rad].
        table: Height of the table [m].
    """
    low, high = HEIGHTS
    turn = (at[3] - estimate[3] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    # Grasps across get one sign, because the mean of +90 and -90 degrees is a grasp
    # along.
    turn = turn + np.pi if turn < -_ACROSS else turn
    values = [
        *((at[:2] - estimate[:2]) / REACH),
        2.0 * (at[2] - table - low) / (high - low) - 1.0,
        min(turn / (0.5 * np.pi), 1.0),
        2.0 * preshape / MOST_PRESHAPE - 1.0,
        2.0 * closure - 1.0,
    ]
    return np.array(values, np.float32)


def one_shot_state(shape: Shape) -> State:
    """Return the object's size, where 1 is 0.15 m, and whether it is round."""
    size = shape.bounding_size / SIZE
    return clipped(np.append(size, isinstance(shape, Cylinder)))


class GraspOneShotEnv(HandEnv):
    """Chooses a whole grasp at once; an episode has a single step.

    Action: x and y of the grasp centre relative to the estimated position (1 is 4 cm),
    its height above the table (2.5 .. 11.5 cm), the yaw relative to the object's (1 is
    90 degrees), the closure on the way down (0 .. 0.45), and the closure of the grasp
    (0 .. 1). The hand comes down, closes, lifts and shakes.
    """

    action_names = ("x", "y", "height", "yaw", "preshape", "closure")
    observation_names = ("size_x", "size_y", "size_z", "round")

    def state(self) -> State:
        """Return the observation; see `one_shot_state`."""
        return one_shot_state(self.scene.shape)

    def step(self, action: Any) -> Step:
        """Grasp, lift and shake."""
        scene = self.scene
        try:
            grasp = grasp_of(checked(action), self.estimate, self.table)
            self.begin(scene, self.joints_at(grasp.over))
            self.move(grasp.at, grasp.preshape, DOWN)
            self.move(grasp.at, grasp.closure, CLOSE)
            self.move(grasp.up, grasp.closure, UP)
            if self.truth().height > LIFTED:
                self.success = self.survives_shake()
        except ObjectLostError:
            pass
        except (SimulationError, ScenarioError) as error:  # the latter: out of reach
            return self.failed_step(error)
        self.lost = not self.success
        truth = self.truth()
        reward = self._reward(None, truth)
        return self.observe(), reward, True, False, self.info(truth)


# A full action moves the hand by this per control period: 0.43 m/s, 2.1 rad/s.
STEP = np.array([0.02, 0.02, 0.02, 0.1])
# Quantities that scale to 1 in the observation [m, m, rad, rad/s, N, rad].
NEAR, SIZE, ANGLE, _SPEED, _FORCE, TURN = 0.2, 0.15, 2.0, 4.0, 20.0, np.pi
MAX_STEPS = 100  # 4.7 s


def pick_state(
    hand: Vector,
    estimate: Vector,
    shape: Shape,
    table: float,
    fingers: Vector,
    force: Vector,
    closure: float,
    elapsed: float,
) -> State:
    """Return the observation of `PickEnv` from measurements.

    Args:
        hand: Pose of the hand, [x, y, z, yaw], shape (4,) [m, rad].
        estimate: Estimate of the object's pose, shape (4,).
        shape: Shape of the object.
        table: Height of the table [m].
        fingers: Positions and velocities of the joints, shape (8,) [rad, rad/s].
        force: Force of the finger links, shape (4,) [N].
        closure: Commanded closure, 0 .. 1.
        elapsed: Share of the longest episode that is over, 0 .. 1.
    """
    turn = 2.0 * (estimate[3] - hand[3])
    round_ = isinstance(shape, Cylinder)
    values = np.concatenate(
        [
            (estimate[:3] - hand[:3]) / NEAR,
            (1.0, 0.0) if round_ else (np.cos(turn), np.sin(turn)),
            [(hand[2] - table) / NEAR],
            shape.bounding_size / SIZE,
            [float(round_)],
            fingers[:4] / ANGLE,
            fingers[4:] / _SPEED,
            force / _FORCE,
            [2.0 * closure - 1.0, 2.0 * elapsed - 1.0, hand[3] / TURN],
        ]
    )
    return clipped(values)


class PickEnv(HandEnv):
    """Moves the hand and its closure until the object is lifted and shaken.

    Action: motion of the hand along x, y, z (1 is 2 cm) and about the vertical (1 is
    0.1 rad), and the closure (-1 open .. 1 closed). Once the object's underside is
    10 cm up, the hand shakes it: the episode ends, and succeeds if the object stays up.
    """

    max_steps: ClassVar[int] = MAX_STEPS
    action_names = ("x", "y", "z", "yaw", "closure")
    observation_names = (
        *("object_x", "object_y", "object_z", "cos_2yaw", "sin_2yaw", "height"),
        *("size_x", "size_y", "size_z", "round"),
        *(f"angle_{i}" for i in range(4)),
        *(f"speed_{i}" for i in range(4)),
        *(f"force_{i}" for i in range(4)),
        *("closure", "time", "yaw"),
    )

    def begin(self, scene: Scene, q: Vector) -> None:
        """Put object and arm at their start."""
        super().begin(scene, q)
        self.steps = 0
        self._truth = self.truth()

    def state(self) -> State:
        """Return the hand's measurements, and the estimate of the object."""
        force = self.station.measured("gripper.contact_force")
        return pick_state(
            self.hand(),
            self.estimate,
            self.scene.shape,
            self.table,
            self.station.measured("gripper.state_measured"),
            force if self.touch else np.zeros(4),
            self.closure,
            self.steps / self.max_steps,
        )

    def step(self, action: Any) -> Step:
        """Move the hand for one control period."""
        _ = self.scene  # raises before the first reset
        before = self._truth
        try:
            a = np.clip(checked(action), -1.0, 1.0)
            pose = self.workspace.within(self.pose + STEP * a[:4])
            self.steps += 1
            self.tick(pose, 0.5 * (a[4] + 1.0))
            self._truth = self.truth()
            terminated = self.finish(self._truth)
        except ObjectLostError:
            terminated, self.success, self.lost = True, False, True
        except SimulationError as error:
            return self.failed_step(error)
        if terminated:
            self._truth = self.truth()
        truth = self._truth
        truncated = not terminated and self.steps >= self.max_steps
        reward = self._reward(before, truth)
        return self.observe(), reward, terminated, truncated, self.info(truth)

    def finish(self, truth: Truth) -> bool:
        """Return whether the episode is over, after a shake if the object is up."""
        if truth.height <= LIFTED:
            return False
        self.success = self.survives_shake()
        self.lost = not self.success
        return True


# Success: for `_STANDS` control periods, the object is within `_TOLERANCE` of its goal
# [m] and within `_LIFT` of the table [m], its lean has at least the cosine `_UPRIGHT`,
# and no finger touches it. It need not be at rest: in the long steps of `train`, a
# standing object keeps bouncing by millimetres.
_STANDS, _TOLERANCE, _LIFT, _UPRIGHT = 8, 0.02, 0.01, np.cos(np.deg2rad(15.0))
FAR = 0.6  # offset of the goal that scales to 1 in the observation [m]


class PickPlaceEnv(PickEnv):
    """Carries the object to `task.place.position`, and lets go of it.

    Action and observation are those of `PickEnv`, with the goal relative to the hand at
    the end. Success: for 0.4 s, the object stands within 2 cm of the goal, free of the
    hand.
    """

    max_steps: ClassVar[int] = 200
    places: ClassVar[bool] = True
    judges_lift: ClassVar[bool] = False
    train_steps: ClassVar[int] = 4
    observation_names = (*PickEnv.observation_names, "goal_x", "goal_y")

    def state(self) -> State:
        """Return the hand's measurements, and the estimate of the object."""
        goal = clipped((self.goal - self.hand()[:2]) / FAR)
        return np.concatenate([super().state(), goal])

    def truth(self) -> Truth:
        """Return the present ground truth.

        Half of the progress measures the distance to the goal.
        """
        truth = super().truth()
        away = np.linalg.norm(truth.station.X_WO().translation()[:2] - self.goal)
        near = 1.0 - np.tanh(4.0 * away)
        progress = 0.5 * truth.progress + 0.5 * float(near)
        return dc.replace(truth, progress=progress)

    def begin(self, scene: Scene, q: Vector) -> None:
        """Put object and arm at their start."""
        super().begin(scene, q)
        self._standing = 0  # control periods in a row

    def finish(self, truth: Truth) -> bool:
        """Return whether the object has stood at its goal for long enough."""
        X_WO = truth.station.X_WO()
        stands = (
            np.linalg.norm(X_WO.translation()[:2] - self.goal) < _TOLERANCE
            and abs(truth.height) < _LIFT
            and X_WO.rotation().matrix()[2, 2] > _UPRIGHT
            and truth.touching == 0.0
        )
        self._standing = self._standing + 1 if stands else 0
        self.success = self._standing >= _STANDS
        return self.success
