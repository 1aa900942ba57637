"""Motion of untouched objects on a table after they have come to rest.

The objects fall as in the cells that clear a table, and the arm waits at home. Sleeping
objects cannot move. Stiction tolerance and steps were chosen on other seeds.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

import experiments.runner as ex
from drake_srg.common.log_format import pose_key, row_to_pose
from drake_srg.objects.config import SleepingConfig
from drake_srg.objects.household import object_facts
from drake_srg.scenario import load_scenario
from drake_srg.types import Vector
from experiments.stands.cells import simulate_whole

TABLES = {"spread": "clear_table_fast", "heap": "clear_heap_fast"}
AS_IS, _AWAKE = "as it is", ("sleeping=null",)
SETTINGS: Mapping[str, tuple[str, ...]] = {
    AS_IS: (),
    "awake, 5 ms": (*_AWAKE, "plant_config.time_step=0.005"),
    "awake, 2.5 ms": (*_AWAKE, "plant_config.time_step=0.0025"),
    "awake, Drake's stiction": (*_AWAKE, "plant_config.stiction_tolerance=1.0e-3"),
}
LATEST, SPAN = 15.0, 10.0  # when all must be at rest, and how long then to watch [s]
# The arm waits until the time is over.
_WAITING = (
    f"planner.latency={2 * (LATEST + SPAN)}",
    f"planner.time_budget={LATEST + SPAN + 1}",
)


def cases(trials: int = 4, seed: int = 10200) -> list[ex.Case]:
    return ex.grid(seed=range(seed, seed + trials), table=TABLES, settings=SETTINGS)


def trial(seed: int, table: str, settings: str) -> ex.Measures:
    overrides = (*_WAITING, *SETTINGS[settings])
    scenario = load_scenario(TABLES[table], seed=seed, overrides=overrides)
    log = simulate_whole(scenario, record=False).log
    points = {}
    for name, config in scenario.objects.items():
        poses = [row_to_pose(row) for row in log[pose_key(name)]]
        p_OP = object_facts(name, config).points
        points[name] = np.array([(X_WO @ p_OP.T).T for X_WO in poses])
    rest, moved = find_stay(log["time"], points)
    if rest is None:
        return {"rest": None, "moved": None, "thing": ""}
    thing = max(moved, key=lambda name: moved[name])
    model = Path(scenario.objects[thing].model or "").stem
    return {"rest": rest, "moved": 1e3 * moved[thing], "thing": model}


def find_stay(
    time: Vector, points: Mapping[str, Vector]
) -> tuple[float | None, dict[str, float]]:
    """Return when all objects have come to rest, and how far each moves after that [m].

    At rest, no point of any object is faster than objects are that fall asleep, for as
    long as that takes (`SleepingConfig`). The time is None if not by `LATEST` [s].
    Points of each object have shape (K, n, 3) in world [m].
    """
    sleeping = SleepingConfig()
    steps = [
        np.linalg.norm(np.diff(p, axis=0), axis=2).max(axis=1) for p in points.values()
    ]
    fastest = np.max(steps, axis=0) / np.diff(time)  # before each sample [m/s]
    slow = np.concatenate([[False], fastest <= sleeping.speed])
    # The last sample before each that was not slow.
    last = np.maximum.accumulate(np.where(slow, -1, np.arange(len(slow))))
    stirred = np.where(last < 0, time[0], time[last])
    rested = np.flatnonzero(slow & (time - stirred >= sleeping.after - 1e-9))
    if not len(rested) or time[rested[0]] > LATEST:
        return None, {}
    first = int(rested[0])
    rows = (time >= time[first]) & (time <= time[first] + SPAN + 1e-9)
    return float(time[first]), {
        name: float(np.linalg.norm(p[rows] - p[first], axis=2).max())
        for name, p in points.items()
    }


def summary(own: ex.Trials) -> ex.Values:
    rests, moved = own.known("rest"), own.known("moved").max(initial=0.0)
    as_is = own[0]["settings"] == AS_IS
    bound = ex.at_most(1.0) if as_is else ex.number(spread=max(1.0, moved))
    some = (len(rests), ex.number(spread=2.0))
    return {
        f"at rest within {LATEST:g} s [of {len(own)} tables]": some,
        f"farthest motion in {SPAN:g} s [mm]": (moved, bound),
    }


untouched = ex.Experiment(
    "Motion of things that have come to rest on a table and that nobody touches.",
    cases,
    trial,
    by=("table", "settings"),
    summary=summary,
    picture=[ex.Points("rest", "moved", limit=1.0, log="y")],
)
