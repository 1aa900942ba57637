"""Chatter of fingers that press on each other when the hand is closed on nothing.

Both fingers press on each other with the full force of their driver, at several time
steps. They do so for as long as the payload experiments hold a load. When the hand
points down, the weight of the fingers presses evenly. With one finger above the other,
the weight moves both slowly until the drive balances it.
"""

import numpy as np

import experiments.runner as ex
from drake_srg.gripper.sensors import TouchConfig
from drake_srg.simulation.rig import Rig, bench_scenario

# Roll, pitch and yaw of the palm [degrees].
HANDS = {"pointing down": (0, 90, 0), "finger above finger": (90, 0, 0)}
DRIVERS = ("SrgPositionDriver", "SrgTendonDriver")
STEPS = {"1 ms": 0.001, "2 ms": 0.002, "5 ms": 0.005}  # s
DURATION = 10.0  # of each run, whose last second is judged [s]
_WINDOW = 0.05  # of a curve's sample [s]


def trial(driver: str, hand: str, step: str) -> ex.Measures:
    """Close an open hand on nothing, sampled every time step."""
    time_step = STEPS[step]
    overrides = [f"gripper=!{driver} {{}}", f"plant_config.time_step={time_step}"]
    scenario = bench_scenario(gripper_rpy=HANDS[hand], overrides=overrides)
    scenario.objects, scenario.task.pick = {}, ""
    with Rig(scenario, name="chatter", period=time_step, log_period=time_step) as rig:
        rig.advance(DURATION, closure=1.0)
        log = rig.log()
    force = log["gripper.contact_force"][:, 2]  # left base, right base, left tip, ...
    speeds = log["gripper.state_measured"][:, 4:]
    last = log["time"] > log["time"][-1] - 1.0
    n = round(_WINDOW / time_step)
    count = (len(force) - 1) // n
    windows = speeds[1 : 1 + n * count].reshape(count, n, -1)
    return {
        "contact force, mean [N]": np.mean(force[last]),
        "fastest joint's speed, RMS [rad/s]": max(
            float(np.sqrt(np.mean(np.square(v)))) for v in speeds[last].T
        ),
        "contact force, peak to peak [N]": np.ptp(force[last]),
        "time [s]": log["time"][n::n][:count],
        "joint speed, RMS [rad/s]": np.sqrt(np.mean(windows**2, axis=1)).max(axis=1),
        "fingertip force [N]": force[n::n][:count],
    }


idle_contact = ex.Experiment(
    "Chatter of fingers that press on each other when the hand is closed on nothing.",
    lambda: ex.grid(driver=DRIVERS, hand=HANDS, step=STEPS),
    trial,
    {
        "contact force, mean": ex.at_least(
            TouchConfig().trigger_force, source="data sheet"
        ),
        # One count per second of the servo's 12-bit encoder: too slow to measure.
        "fastest joint's speed, RMS": ex.at_most(
            2.0 * np.pi / 4096.0, source="data sheet"
        ),
        # Resolution of thin-film force sensors: a hundredth of the mean force.
        "contact force, peak to peak": lambda own: ex.at_most(
            0.01 * own.one("contact force, mean [N]")
        ),
    },
    by=("driver", "hand", "step"),
    picture=[
        ex.Curves("time [s]", "joint speed, RMS [rad/s]", log="y"),
        ex.Curves("time [s]", "fingertip force [N]"),
    ],
)
