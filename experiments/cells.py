"""Both cells as README quotes them: a few seeds each, and many with everything varied.

The seeds of the varied cells were used for nothing else.
"""

import numpy as np

import experiments.runner as ex
from experiments.stands.cells import metrics_of

FIXED = ("kitchen", "kitchen_fast", "kitchen_tendon", "assistive_arm")
# By scenario, its first seed.
VARIED = {"kitchen_varied": 1_200_000, "assistive_arm_varied": 800_000}


def cases(seeds: int = 20, trials: int = 300) -> list[ex.Case]:
    """Run every cell.

    Args:
        seeds: Runs of each cell whose scenario varies little.
        trials: Runs of each varied cell.
    """
    return [
        *ex.grid(scenario=FIXED, seed=range(seeds)),
        *(
            {"scenario": name, "seed": seed}
            for name, first in VARIED.items()
            for seed in range(first, first + trials)
        ),
    ]


def trial(scenario: str, seed: int) -> ex.Measures:
    """Run a cell once; errors in mm."""
    m = metrics_of(scenario, seed)
    off, seen = (m[f"{what}_error_m"] for what in ("placement", "localization"))
    return {
        "placed": m["success"],
        "first": m["success"] and m["attempts"] == 1,
        "wrong": m["failure"] is None and not m["success"],
        "failure": m["failure"] or "",
        "off": np.full(3, np.nan) if off is None else 1e3 * np.abs(off),
        "seen": np.full(3, np.nan) if seen is None else 1e3 * np.abs(seen),
        "cycle": m["cycle_time_s"],
    }


def summary(own: ex.Trials) -> ex.Values:
    """Count the successes of a cell; state its largest errors if it varies little."""
    n, placed = len(own), sum(own["placed"])
    found: ex.Values = {
        "runs []": n,
        "successes []": (placed, ex.at_least(0.99 * n, spread=0.01 * n)),
        "successes at the first attempt []": (sum(own["first"]), ex.number()),
        "claimed, but not placed []": sum(own["wrong"]),
    }
    if own.name in VARIED:
        failed = own.where(placed=False)["failure"]
        return found | {
            **ex.share("share of successes", placed, n, spread=0.01),
            **ex.counts(failed, "runs", least=3.0),
        }
    for what, key in (("placement", "off"), ("localisation", "seen")):
        for i, axis in enumerate("xyz"):
            largest = np.nanmax(np.stack(own[key])[:, i])
            found[f"largest {what} error, {axis} [mm]"] = largest
    return found | {"longest cycle [s]": max(own.known("cycle"))}


cells = ex.Experiment(
    "Both cells, with a few seeds each and with everything varied.",
    cases,
    trial,
    {
        "claimed, but not placed": ex.at_most(0),
        "largest placement error, x": ex.at_most(2.0),
        "largest placement error, y": ex.at_most(2.0),
        "largest localisation error, x": ex.at_most(0.5),
        "largest localisation error, y": ex.at_most(0.5),
        "longest cycle": ex.at_most(8.0),
    },
    summary=summary,
    picture=[ex.Histogram("cycle")],
)
