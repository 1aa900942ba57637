"""Strategies of insertion, with a hand that yields and with a stiffer one.

The trials are those of `insert_varied` with a clearance of 0.1 mm: the same seed draws
the same part and the same error of the goal for every strategy. The stiff hand has the
greatest stiffness of KUKA's Sunrise.OS, so that mainly the fingers yield.
"""

import numpy as np

import experiments.runner as ex
from drake_srg import Simulate, load_scenario

STRATEGIES = ("tilt", "spiral", "push")
# Stiffness of the hand [N/m], [N m/rad].
HANDS = {"yielding": (2000.0, 200.0), "stiff": (5000.0, 300.0)}
_CLEARANCE = 'chosen.clearance="0.1 mm"'


def trial(strategy: str, hand: str, seed: int) -> ex.Measures:
    along, about = HANDS[hand]
    changes = [
        *(_CLEARANCE, f"planner.strategy={strategy}"),
        *(f"planner.stiffness={along}", f"planner.turning_stiffness={about}"),
        f"arm.cartesian.translation=[{along}, {along}, {along}]",
        f"arm.cartesian.rotation={about}",
    ]
    scenario = load_scenario("insert_varied", seed=seed, overrides=changes)
    metrics = Simulate(scenario).metrics
    return {
        "inserted": metrics.success,
        "force": metrics.hole_force_n,
        "cycle": metrics.cycle_time_s,
    }


def summary(own: ex.Trials) -> ex.Values:
    inserted = int(sum(own["inserted"]))
    low, high = ex.wilson(inserted, len(own))
    cycles = own.known("cycle")
    return {
        "inserted []": inserted / len(own),
        "at least, 95 % []": low,
        "at most, 95 % []": high,
        "largest force on the hole [N]": max(own["force"]),
        "median cycle [s]": np.median(cycles) if len(cycles) else np.nan,
    }


insertion_strategies = ex.Experiment(
    "Insertion at 0.1 mm: strategies, with a yielding and with a stiff hand.",
    lambda trials=10, seed=76000: ex.grid(
        seed=range(seed, seed + trials), strategy=STRATEGIES, hand=HANDS
    ),
    trial,
    by=("strategy", "hand"),
    summary=summary,
)
