"""The slide of a cylinder in the hand that carries it, at several time steps.

Contact without slip gives a held object the hand's velocity at the beginning of each
step. The step then moves the object along a straight line, while the joints move the
hand along a curve. In each step h, the object therefore moves outwards by h^2 a_n / 2,
where a_n is the acceleration across the path. Friction sees no slip to act against.

Over a motion, this adds up to h/2 times the integral of a_n. Unless the pads hold the
object back, it slides by that distance, which vanishes with the step.
"""

import numpy as np

import experiments.runner as ex
from drake_srg import ScenarioError, load_scenario
from drake_srg.common.log_format import pose_key
from drake_srg.simulation.measures import hand_poses
from drake_srg.types import Mode, Vector
from experiments.stands.cells import simulate_whole

# Scenario, the key of its time step, and steps, each half the one before [s]. The
# integrator of the fast scenario takes each step in two halves.
STEPS: dict[str, tuple[str, tuple[float, ...]]] = {
    "assistive_arm": ("plant_config.time_step", (0.005, 0.0025, 0.00125)),
    "assistive_arm_fast": (
        "simulator_config.max_step_size",
        (0.01171875, 0.005859375, 0.0029296875),
    ),
}
# Largest slide beyond the effect of the steps [mm]: a fifth of the recess's clearance.
LIMIT = 0.2


def cases() -> list[ex.Case]:
    return [
        {"name": f"{scenario}, {1e3 * h:.3g} ms", "scenario": scenario, "step": h}
        for scenario, (_, steps) in STEPS.items()
        for h in steps
    ]


def trial(name: str, scenario: str, step: float) -> ex.Measures:
    """Run a scenario and return how the cylinder slides during the transfer."""
    key, steps = STEPS[scenario]
    # A multiple of every step: a log sample within a step would cut the step short.
    period = 2 * steps[0] if steps[0] < 0.01 else steps[0]
    overrides = [f"{key}={step}", f"recording.period={period}"]
    loaded = load_scenario(scenario, overrides=overrides)
    log = simulate_whole(loaded, name=name).log
    while_carried = np.flatnonzero(log["mode"] == list(Mode).index(Mode.TRANSFER))
    if not len(while_carried):
        raise ScenarioError(f"carrying: {name}: the arm carries nothing")
    log = {key: values[while_carried] for key, values in log.items()}
    time, p_WO = log["time"], log[pose_key(loaded.task.pick)][:, :3]
    hands = hand_poses(loaded, log["arm.state_cheat"])
    p_GO = [X_WG.inverse() @ p for X_WG, p in zip(hands, p_WO, strict=True)]
    slide = 1e3 * np.linalg.norm(np.array(p_GO) - p_GO[0], axis=1)
    by_steps = 1e3 * leaving(time, p_WO, step / (2 if "fast" in scenario else 1))
    return {
        "time [s]": time - time[0],
        "slide [mm]": slide,
        "caused by the steps [mm]": by_steps,
        "slide caused by the steps [mm]": by_steps[-1],
        "slide in the hand [mm]": max(slide),
    }


def leaving(time: Vector, position: Vector, step: float) -> Vector:
    """Return the distance by which steps [s] leave a path up to each time, (K,) [m].

    A body is at positions (K, 3) [m] at times (K,) [s].
    """
    v = np.gradient(position, time, axis=0)
    a = np.gradient(v, time, axis=0)
    speed = np.linalg.norm(v, axis=1)
    across = np.linalg.norm(np.cross(v, a), axis=1) / np.maximum(speed, 1e-9)
    return np.asarray(0.5 * step * np.cumsum(across * np.gradient(time)))


def at_step_0(trials: ex.Trials) -> dict[str, ex.Values]:
    """Expect no slide at step 0, by Richardson extrapolation of a first-order error."""
    found = {}
    for scenario, own in trials.groups("scenario").items():
        *_, coarse, fine = own["slide in the hand [mm]"]
        rest = abs(2.0 * fine - coarse)
        found[scenario] = {"slide in the hand, extrapolated to step 0 [mm]": rest}
    return found


carrying = ex.Experiment(
    "The slide of a cylinder in the hand that carries it, at several time steps.",
    cases,
    trial,
    {
        "slide in the hand": lambda own: ex.at_most(
            own.one("slide caused by the steps [mm]") + LIMIT
        ),
        "slide in the hand, extrapolated to step 0": ex.at_most(LIMIT),
    },
    whole=at_step_0,
    picture=[
        ex.Curves(
            "time [s]",
            ("slide [mm]", "caused by the steps [mm]"),
            where={"scenario": scenario},
            title=scenario,
        )
        for scenario in STEPS
    ],
)
