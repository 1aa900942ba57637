"""Times robosuite: a scripted cycle of PickPlaceCan, and control steps of Lift.

Run by the interpreter of an environment that has robosuite, which need not have Drake.
Prints one line of JSON. The cycle is comparable with the kitchen's: an IIWA picks a can
and puts it down elsewhere, without images and without planning.
"""

import json
import logging
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

_OPEN, _CLOSED = -1.0, 1.0
_STEP = 0.05  # motion of the hand at full command [m per control step]
_CLOSING = 12  # control steps in which the fingers close or open
_ABOVE = 0.2  # height above can and bin of the way over [m]
_MOST = 60  # control steps of a single motion
_LIFT_STEPS = 300


def main() -> None:
    """Print the times of both, after a first cycle that loads everything."""
    logging.disable(logging.WARNING)  # robosuite advises about what it lacks
    import robosuite

    can = _make("PickPlaceCan")
    _cycle(can)
    times = {
        "version": robosuite.__version__,
        **_cycle(can),
        "lift_steps_per_s": _lift_rate(_make("Lift")),
    }
    print(json.dumps(times))


def _make(task: str) -> Any:
    import robosuite
    from robosuite.controllers import load_composite_controller_config

    config = load_composite_controller_config(controller="BASIC", robot="IIWA")
    return robosuite.make(
        task,
        robots="IIWA",
        controller_configs=config,
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        control_freq=20,
        horizon=10_000,
        seed=0,
    )


def _cycle(env: Any) -> dict[str, Any]:
    """Carry the can into its bin; return success, simulated time and wall clock [s]."""
    seen = env.reset()
    can = np.array(seen["Can_pos"])
    goal = np.array(env.target_bin_placements[env.object_to_id["can"]])
    high, goal_high = can + [0.0, 0.0, _ABOVE], goal + [0.0, 0.0, _ABOVE + 0.1]
    steps = 0
    start = time.perf_counter()
    for hand, fingers, wait in (
        (high, _OPEN, 0),
        (can, _OPEN, 0),
        (can, _CLOSED, _CLOSING),
        (high, _CLOSED, 0),
        (goal_high, _CLOSED, 0),
        (goal + [0.0, 0.0, 0.1], _CLOSED, 0),
        (goal + [0.0, 0.0, 0.1], _OPEN, _CLOSING),
        (goal_high, _OPEN, 0),
    ):
        for action in _motion(lambda: seen["robot0_eef_pos"], hand, fingers, wait):
            seen, *_ = env.step(action)
            steps += 1
    return {
        "success": bool(env._check_success()),
        "simulated": steps * env.control_timestep,
        "total": time.perf_counter() - start,
    }


def _motion(
    where: Callable[[], Any], target: Any, fingers: float, wait: int
) -> Iterator[Any]:
    """Yield actions until the hand is at its target, or for `wait` control steps."""
    for step in range(wait or _MOST):
        away = target - where()
        if not wait and step and np.linalg.norm(away) < 0.01:
            return
        move = np.clip(away / _STEP, -1.0, 1.0)
        yield np.concatenate([move, np.zeros(3), [fingers]])


def _lift_rate(env: Any) -> float:
    """Return the control steps per second, at rest."""
    env.reset()
    still = np.zeros(env.action_dim)
    env.step(still)
    start = time.perf_counter()
    for _ in range(_LIFT_STEPS):
        env.step(still)
    return _LIFT_STEPS / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
