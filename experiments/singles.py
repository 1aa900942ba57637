"""One thing at a time cleared into a bin: household objects, shapes and new meshes.

Each object falls on the table in any orientation. The planner sees only a noisy depth
image and does not know the object. Ground truth decides whether the object has a side
that fits the hand: the distance of two parallel vertical planes that enclose it where
it rests.
"""

import time as clock
from pathlib import Path

import numpy as np

import experiments.runner as ex
from drake_srg.common.log_format import MODES
from drake_srg.objects.household import HOUSEHOLD
from drake_srg.scenario import load_scenario
from drake_srg.types import Mode, Vector
from experiments import FOLDER
from experiments.clearing import NOISE, WIDEST
from experiments.stands.cells import simulate_whole

SCENARIO = "clear_table_fast"
GROUPS = ("household", "shapes", "meshes")
# Asked for: shares that are in the bin after the first grasp and after three.
FIRST, ANY = (ex.at_least(least, spread=0.02) for least in (0.97, 0.997))

# As `clear_table` draws it: on any side, as it falls.
_POSE = (
    "tilt: [!Uniform {min: -3.1416, max: 3.1416}, !Uniform {min: -1.5708, max: 1.5708}]"
    ", yaw: !Uniform {min: -3.1416, max: 3.1416}, drop: 0.005"
)
_MATERIAL = "mass: 0.2, friction: 0.6"
# Facets of a tenth of the least radius, or round things roll from facet to facet.
_ROUND = f"{_MATERIAL}, resolution: 0.002"
_SHAPES = (
    f"{_MATERIAL}, shape: !Box {{size: !UniformVector "
    "{min: [0.02, 0.03, 0.04], max: [0.08, 0.1, 0.15]}}",
    f"{_ROUND}, shape: !Cylinder {{radius: !Uniform {{min: 0.02, max: 0.04}}, "
    "length: !Uniform {min: 0.03, max: 0.15}}",
    f"{_ROUND}, shape: !Sphere {{radius: !Uniform {{min: 0.02, max: 0.045}}}}",
)
# An angle, a bow, a cross, a ring, a star and a wedge, in millimetres.
MESHES = sorted((FOLDER / "data/meshes").glob("*.obj"))


def thing(group: str, number: int) -> str:
    """Return an object of a group as YAML; the number chooses a kind in turn."""
    if group == "shapes":
        own = _SHAPES[number % len(_SHAPES)]
    elif group == "household":
        name = HOUSEHOLD[number % len(HOUSEHOLD)]
        own = f"model: package://drake_srg/sdf/{name}.sdf"
    else:
        mesh = MESHES[number % len(MESHES)]
        own = f"model: {mesh}, scale: 0.001, {_MATERIAL}"
    return f"{{{own}, {_POSE}}}"


def cases(trials: int = 1000, seed: int = 1_110_000) -> list[ex.Case]:
    """Clear single things of all groups in turn."""
    return [{"group": GROUPS[s % 3], "seed": s} for s in range(seed, seed + trials)]


def trial(group: str, seed: int) -> ex.Measures:
    start = clock.process_time()
    own = f"objects={{thing: {thing(group, seed // len(GROUPS))}}}"
    overrides = (*NOISE, "clutter.count=0", own)
    scenario = load_scenario(SCENARIO, seed=seed, overrides=overrides)
    result = simulate_whole(scenario, name=SCENARIO)
    metrics, log = result.metrics, result.log
    assert metrics.objects is not None
    outcome = metrics.objects["thing"]
    time = _pick_time(log["time"], log["mode"], scenario.planner.latency)
    cleared, picks = bool(outcome["cleared"]), metrics.picks or 0
    model = scenario.objects["thing"].model
    return {
        "kind": Path(model).stem if model else "shape",
        "counts": float(outcome["width_m"]) <= WIDEST,
        "once": cleared and picks == 1,
        "cleared": cleared,
        "false": bool(metrics.picks_held) and not cleared,
        "outcome": str(outcome["outcome"]),
        "pick_time": time,
        "time": clock.process_time() - start,
    }


def _pick_time(time: Vector, mode: Vector, latency: float) -> float | None:
    """Return the time from the first plan until the first load is let go [s]."""
    begun = np.flatnonzero(mode == MODES.index(Mode.PRE_GRASP))
    released = np.flatnonzero(mode == MODES.index(Mode.RELEASE))
    if not len(begun) or not len(released):
        return None
    # The end of the first release: the next sample in another mode.
    after = np.flatnonzero(mode[released[0] :] != MODES.index(Mode.RELEASE))
    end = released[0] + after[0] if len(after) else len(mode) - 1
    return float(time[end] - time[begun[0]] + latency)


def whole(trials: ex.Trials) -> dict[str, ex.Values]:
    own = trials.where(counts=True)
    found: dict[str, ex.Values] = {}
    for name in ("all", *GROUPS):
        these = own if name == "all" else own.where(group=name)
        found[name] = {"counted []": (len(these), ex.number(spread=5.0))}
        for what, measure, asked in (
            ("in the bin, first grasp", "once", FIRST),
            ("in the bin, three grasps", "cleared", ANY),
        ):
            n = sum(these[measure])
            found[name] |= ex.share(what, n, len(these), spread=0.04)
            if name == "all":
                found[name][f"{what} []"] = (n / max(len(these), 1), asked)
    times = own.known("pick_time")
    rate = 3600.0 / np.median(times) if len(times) else 0.0
    found["all"] |= {
        "trials []": (len(trials), ex.number(spread=1.0)),
        "picks per hour, median [1/h]": rate,
        "claimed, not in the bin [things]": sum(trials["false"]),
        "processor time of a trial [s]": np.median(trials["time"]),
    }
    missed = own.where(cleared=False)["outcome"]
    return found | {"not in the bin": ex.counts(missed, "things", least=2.0)}


singles = ex.Experiment(
    "One thing at a time cleared into a bin: household objects, shapes and new meshes.",
    cases,
    trial,
    {
        "picks per hour, median": ex.at_least(650.0),
        "claimed, not in the bin": ex.at_most(0.0),
        # So that two workers take half.
        "processor time of a trial": ex.at_most(4.0, clock="time"),
    },
    whole=whole,
    picture=[ex.Bars(["in the bin, first grasp", "in the bin, three grasps"])],
)
