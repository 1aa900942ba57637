"""Pick: small motions of the hand until the object is up."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from drake_srg.envs.episode_station import SimulationError
from drake_srg.envs.hand_env import HandEnv, State, Step, checked, clipped
from drake_srg.envs.hand_task import ObjectLostError
from drake_srg.envs.rewards import LIFTED, Truth
from drake_srg.envs.scenes import Scene
from drake_srg.types import Cylinder, Shape, Vector

# A full action moves the hand by this per control period: 0.43 m/s, 2.1 rad/s.
STEP = np.array([0.02, 0.02, 0.02, 0.1])
# What entries of the observation are 1 for.
_NEAR, _SIZE, _ANGLE, _SPEED, _FORCE = 0.2, 0.15, 2.0, 4.0, 20.0
_TURN = np.pi
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
    """Return the observation of `PickEnv` from what is sensed.

    Args:
        hand: Its pose, [x, y, z, yaw], shape (4,) [m, rad].
        estimate: The object's, shape (4,).
        shape: Of the object.
        table: Height of the table [m].
        fingers: Positions and velocities of the joints, shape (8,) [rad, rad/s].
        force: Of the finger links, shape (4,) [N].
        closure: As commanded, 0 .. 1.
        elapsed: Share of the longest episode that is over, 0 .. 1.
    """
    turn = 2.0 * (estimate[3] - hand[3])
    round_ = isinstance(shape, Cylinder)
    values = np.concatenate(
        [
            (estimate[:3] - hand[:3]) / _NEAR,
            (1.0, 0.0) if round_ else (np.cos(turn), np.sin(turn)),
            [(hand[2] - table) / _NEAR],
            shape.bounding_size / _SIZE,
            [float(round_)],
            fingers[:4] / _ANGLE,
            fingers[4:] / _SPEED,
            force / _FORCE,
            [2.0 * closure - 1.0, 2.0 * elapsed - 1.0, hand[3] / _TURN],
        ]
    )
    return clipped(values)


class PickEnv(HandEnv):
    """Moves the hand and its closure until the object is lifted and shaken.

    Action: motion of the hand along x, y, z (1 is 2 cm) and about the vertical (1 is
    0.1 rad), and the closure (-1 open .. 1 closed). Once the object's underside is
    10 cm up, the hand shakes it: the episode ends, in success if the object stays up.
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
        """See `HandTask`."""
        super().begin(scene, q)
        self.steps = 0
        self._truth = self.truth()

    def state(self) -> State:
        """Return what the hand senses, and the object as it was estimated."""
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
