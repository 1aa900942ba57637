"""GraspOneShot: one action is one grasp."""

from __future__ import annotations

import dataclasses as dc
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.envs.episode_station import SimulationError
from drake_srg.envs.hand_env import HandEnv, State, Step, checked, clipped
from drake_srg.envs.hand_task import ObjectLostError
from drake_srg.envs.rewards import LIFTED
from drake_srg.envs.workspace import LOWEST, START_HEIGHT
from drake_srg.types import Cylinder, Shape, Vector

# Control periods of each part of the grasp: 0.75 s down, 0.75 s to close, 0.56 s up.
DOWN, CLOSE, UP = 16, 16, 12
REACH = 0.04  # around the estimated position [m]
HEIGHTS = (LOWEST, 0.115)  # of the grasp centre above the table [m]
MOST_PRESHAPE = 0.45
_ACROSS = np.deg2rad(80.0)


@dc.dataclass(frozen=True, eq=False)
class Grasp:
    """What an action means.

    Attributes:
        over: Pose of the hand (4) above the grasp, [x, y, z, yaw] [m, rad].
        at: Pose at which it closes.
        up: Pose to which it lifts.
        preshape: Closure on the way down, 0 .. 1.
        closure: Of the grasp.
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
        estimate: Of the object, [x, y, z, yaw], shape (4,) [m, rad].
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
    """Return the action that stands for a grasp: the inverse of `grasp_of`.

    The hand looks the same after half a turn, so every yaw has an action. Entries
    beyond -1 .. 1 say that the environment does not know the grasp.

    Args:
        at: Pose at which the hand closes, [x, y, z, yaw], shape (4,) [m, rad].
        preshape: Closure on the way there, 0 .. 1.
        closure: Of the grasp.
        estimate: Of the object, [x, y, z, yaw], shape (4,) [m, rad].
        table: Height of the table [m].
    """
    low, high = HEIGHTS
    turn = (at[3] - estimate[3] + 0.5 * np.pi) % np.pi - 0.5 * np.pi
    # One sign for grasps across: half a turn apart, their mean would be along.
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
    """Return the observation: the size, 1 for 0.15 m, and whether it is round."""
    size = shape.bounding_size / 0.15
    return clipped(np.append(size, isinstance(shape, Cylinder)))


class GraspOneShotEnv(HandEnv):
    """Chooses a whole grasp at once; an episode has a single step.

    Action: x and y of the grasp centre from the estimated position (1 is 4 cm), its
    height above the table (2.5 .. 11.5 cm), the yaw from the object's (1 is 90
    degrees), the closure on the way down (0 .. 0.45), and the closure of the grasp
    (0 .. 1). The hand comes down, closes, lifts and shakes.
    """

    action_names = ("x", "y", "height", "yaw", "preshape", "closure")
    observation_names = ("size_x", "size_y", "size_z", "round")

    def state(self) -> State:
        """See `one_shot_state`."""
        return one_shot_state(self.scene.shape)

    def step(self, action: Any) -> Step:
        """Grasp, lift and shake."""
        try:
            grasp = grasp_of(checked(action), self.estimate, self.table)
            self.begin(self.scene, self.joints_at(grasp.over))
            self.move(grasp.at, grasp.preshape, DOWN)
            self.move(grasp.at, grasp.closure, CLOSE)
            self.move(grasp.up, grasp.closure, UP)
            if self.truth().height > LIFTED:
                self.success = self.survives_shake()
        except ObjectLostError:
            pass
        except (SimulationError, ScenarioError) as error:  # or out of the arm's reach
            return self.failed_step(error)
        self.lost = not self.success
        truth = self.truth()
        reward = self._reward(None, truth)
        return self.observe(), reward, True, False, self.info(truth)
