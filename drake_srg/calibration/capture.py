"""A simulated run in which the arm shows the board to the camera."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from drake_srg.calibration.mounting import Mounting, with_board
from drake_srg.calibration.shots import Shot
from drake_srg.calibration.visits import plan_visits
from drake_srg.common.exceptions import ScenarioError
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.planning_scene import PlanningScene
from drake_srg.scenario import Scenario
from drake_srg.simulation.rig import Rig
from drake_srg.types import Vector

# Share of the arm's speed and acceleration; images are taken at rest, so the way there
# does not matter.
_SPEED = 0.9
# The arm rests once no joint is faster than this [rad/s]; at a metre that is 0.1 mm in
# the time between two readings of its joints.
_REST_SPEED = 2e-3
_REST_WAIT, _MOST_WAITS = 0.1, 50  # s
_NO_LOG = 10.0  # s


def take_shots(
    scenario: Scenario,
    mounting: Mounting,
    scene: PlanningScene,
    count: int,
    tell: Callable[[int], None] = lambda taken: None,
) -> list[Shot]:
    """Move the arm through many postures, and take an image in each.

    The hand's pose follows from the measured joint positions, as on hardware.

    Args:
        scenario: The scenario, without the board.
        mounting: Camera and board.
        scene: The arm, and what to keep clear of.
        count: How many images.
        tell: Called with the number of images taken so far.

    Raises:
        ScenarioError: If the arm cannot show the board, or does not come to rest.
    """
    assert scenario.arm is not None
    home = np.array(scenario.arm.home)
    paths = plan_visits(mounting, scene, home, count, scenario.random_seed)
    limits = MotionLimits.of_plant(scene).scaled(_SPEED, _SPEED)
    shots: list[Shot] = []
    shown = with_board(scenario, mounting)
    # Nobody reads the log.
    with Rig(shown, name="calibrate", log_period=_NO_LOG, images=True) as rig:
        for path in paths:
            tell(len(shots))
            for start, end in itertools.pairwise(path):
                rig.move(end, _duration(np.abs(end - start), limits))
            q = _rest(rig, scene.num_joints)
            X_WH = mounting.X_WH(scene, q)
            name = f"view_{len(shots):02d}.png"
            shots.append(Shot(name, rig.image(mounting.camera), X_WH))
    return shots


def _duration(way: Vector, limits: MotionLimits) -> float:
    """Return the time of a minimum-jerk motion within the limits [s]."""
    # Peaks of speed and acceleration over way / time and way / time^2.
    speed = 1.875 * way / limits.velocity
    acceleration = np.sqrt(5.774 * way / limits.acceleration)
    return float(max(speed.max(), acceleration.max(), 0.1))


def _rest(rig: Rig, num_joints: int) -> Vector:
    """Wait until the arm rests, and return its measured joint positions (N) [rad]."""
    for _ in range(_MOST_WAITS):
        rig.advance(_REST_WAIT)
        state = rig.measured("arm.state_measured")
        if np.abs(state[num_joints:]).max() < _REST_SPEED:
            return np.asarray(state[:num_joints])
    raise ScenarioError(
        f"the arm is still moving {_MOST_WAITS * _REST_WAIT:g} s after a motion"
    )
