"""Times of robosuite: a scripted cycle of PickPlaceCan, and control steps of Lift.

`benchmark.measure_robosuite` runs this file with the Python of an environment that has
robosuite; Drake is not needed. The file prints one line of JSON. The cycle is
comparable with the kitchen's: an IIWA picks a can and puts it down elsewhere, without
images and without planning.
"""

import json
import logging
import time
from typing import Any

import numpy as np

_OPEN, _CLOSED = -1.0, 1.0
_STEP = 0.05  # motion of the hand at full command [m per control step]
_CLOSING = 12  # control steps in which the fingers close or open
_ABOVE = 0.2  # height to which the can is lifted, above its start [m]
_NEAR = 0.01  # distance at which the hand counts as at its target [m]
_MOST = 60  # largest number of control steps of a motion
_LIFT_STEPS = 300


def main() -> None:
    """Print the times, after a first cycle that loads everything."""
    logging.disable(logging.WARNING)  # robosuite warns about missing options
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
    """Carry the can into its bin; return success, simulated and wall-clock time [s]."""
    seen = env.reset()
    can = np.array(seen["Can_pos"])
    goal = np.array(env.target_bin_placements[env.object_to_id["can"]])
    up = np.array([0.0, 0.0, 1.0])
    high, goal_low, goal_high = can + _ABOVE * up, goal + 0.1 * up, goal + 0.3 * up
    steps = 0
    start = time.perf_counter()
    for hand, fingers, wait in (
        (high, _OPEN, 0),
        (can, _OPEN, 0),
        (can, _CLOSED, _CLOSING),
        (high, _CLOSED, 0),
        (goal_high, _CLOSED, 0),
        (goal_low, _CLOSED, 0),
        (goal_low, _OPEN, _CLOSING),
        (goal_high, _OPEN, 0),
    ):
        for step in range(wait or _MOST):
            away = hand - seen["robot0_eef_pos"]
            if not wait and step and np.linalg.norm(away) < _NEAR:
                break
            move = np.clip(away / _STEP, -1.0, 1.0)
            seen, *_ = env.step(np.concatenate([move, np.zeros(3), [fingers]]))
            steps += 1
    return {
        "success": bool(env._check_success()),
        "simulated": steps * env.control_timestep,
        "total": time.perf_counter() - start,
    }


def _lift_rate(env: Any) -> float:
    """Return the number of control steps per second, with the arm at rest."""
    env.reset()
    still = np.zeros(env.action_dim)
    env.step(still)
    start = time.perf_counter()
    for _ in range(_LIFT_STEPS):
        env.step(still)
    return _LIFT_STEPS / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
