"""What work costs on this machine: recording, and sweeps.

`recording_cost`: processor time of all threads in a worker of a sweep, with one thread
each for rendering and linear algebra, relative to an unrecorded trial; it varies by a
tenth between equal runs. `sweep_throughput`: the wall clock of a whole sweep with one
worker and with two, including checks and the start of the workers; it is meaningful
only on an otherwise idle machine with at least two cores. `overhead` is what `make
bench-guard` runs: a scenario's wall-clock time over that of its bare plant on the same
inputs, and over that of a loop in Python, which slow down together on a slow machine.
"""

import tempfile
import time as wall
from pathlib import Path

import numpy as np

import experiments.runner as ex
from drake_srg.lifetime import free_diagrams
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.simulation.benchmark import run_benchmark
from drake_srg.sweeps.engines import JoblibEngine
from drake_srg.sweeps.sweep import run_sweep
from drake_srg.types import Vector

_NO_VIDEO, _NO_IMAGES = "recording.video_camera=''", "recording.bag_cameras=[]"
# What is recorded, and the overrides for it; None records nothing.
PARTS: dict[str, tuple[str, ...] | None] = {
    "unrecorded": None,
    "numbers alone": (_NO_VIDEO, _NO_IMAGES),
    "video, no images": (_NO_IMAGES,),
    "images, no video": (_NO_VIDEO,),
    "images, and the same as video": ("recording.video_camera=ceiling",),
    "everything": (),
    "everything, video of 1280 x 720": (
        "cameras.overview.width=1280",
        "cameras.overview.height=720",
    ),
}


def processor_time(scenario: str, part: str, seed: int) -> float:
    """Run a trial and return its processor time, build included [s]."""
    overrides = PARTS[part]
    start = wall.process_time()
    loaded = load_scenario(scenario, seed=seed, overrides=overrides or ())
    with tempfile.TemporaryDirectory() as folder:
        out = None if overrides is None else Path(folder)
        record = out is not None
        # As in a sweep, without a process for the video.
        Simulate(loaded, name=scenario, out=out, record=record, video_process=False)
    elapsed = wall.process_time() - start
    free_diagrams()  # as a sweep does after each trial
    return elapsed


def recording_trial(scenario: str) -> ex.Measures:
    """Run the same trials with each part recorded; return medians."""
    with JoblibEngine(1) as engine:

        def cost(part: str, seed: int) -> float:
            return engine.submit(processor_time, scenario, part, seed).result()

        cost("everything", 0)  # imports happen once and belong to no trial
        costs = np.array([[cost(part, seed) for part in PARTS] for seed in range(3)])
    ratios = np.median(costs / costs[:, :1], axis=0)
    found = {f"{p} [x unrecorded]": r for p, r in zip(PARTS, ratios, strict=True)}
    del found["unrecorded [x unrecorded]"]
    return found | {"unrecorded [s]": np.median(costs[:, 0])}


def varies(cost: float) -> float:
    """Return the spread of a ratio of costs that each vary by a tenth."""
    return 0.2 * cost


recording_cost = ex.Experiment(
    "Cost of recording a trial of a sweep, part by part, over an unrecorded one.",
    lambda: ex.grid(scenario=("kitchen_varied", "assistive_arm_varied")),
    recording_trial,
    {
        **dict.fromkeys(PARTS, ex.number(spread=varies)),
        "everything": ex.at_most(3.0, spread=varies, known="images take most of it"),
        "unrecorded": ex.number(clock="time"),
    },
    picture=[ex.Bars([part]) for part in ("numbers alone", "everything")],
    serial=True,
)

_MEMORY = 600.0  # greatest memory of a worker [MB]
# Trials after which a worker has loaded everything. Its growth is judged from there.
_WARM = 20
# Greatest growth of a worker's memory [MB per trial]: from 410 MB, when it is warm, it
# must stay below _MEMORY for a thousand trials. Steps of 17 MB, which come and go, are
# slopes of at most 1.5 * 17 / n over n trials: 0.14 over the 180 trials of a single
# worker, but 0.32 over the 80 of each of two, whose growth is therefore not judged.
_GROWTH, _STEP = (_MEMORY - 410.0) / 1000, 17.0


def sweep_trial(jobs: int) -> ex.Measures:
    """Run a sweep into a temporary folder; return each worker's memory [MB]."""
    with tempfile.TemporaryDirectory() as folder:
        start, engine = wall.perf_counter(), JoblibEngine(jobs)
        rows = run_sweep("kitchen_varied", 200, out=Path(folder), engine=engine)
        elapsed = wall.perf_counter() - start
    worker = np.array(rows["worker"].to_pylist())
    memory = np.array(rows["memory_mb"].to_pylist(), dtype=float)
    used = [memory[worker == w] for w in np.unique(worker)]
    return {
        "wall": elapsed,
        "memory": used,
        "trial": np.arange(len(used[0])),
        "memory of a worker [MB]": used[0],
    }


def sweep_rows(trials: ex.Trials) -> dict[str, ex.Values]:
    """Expect two workers to be nearly twice as fast, and memory not to grow."""
    one, two = trials["wall"]
    found: dict[str, ex.Values] = {
        "2 : 1": {"throughput []": (one / two, ex.at_least(1.9))}
    }
    for t in trials:
        jobs, largest, slopes = t["jobs"], [], []
        for memory in t["memory"]:
            later: Vector = memory[min(_WARM, len(memory) // 2) :]
            slope = np.polyfit(np.arange(len(later)), later, 1)[0]
            step = 1.5 * _STEP / len(later)
            judged = ex.at_most(_GROWTH, spread=step)
            slopes.append((slope, judged if jobs == 1 else ex.number(spread=step)))
            largest.append((max(memory), ex.at_most(_MEMORY)))
        found[f"{jobs} at a time"] = {
            "wall clock [s]": (t["wall"], ex.number(clock="time")),
            "largest memory of a worker [MB]": largest,
            "growth a trial [MB]": slopes,
        }
    return found


sweep_throughput = ex.Experiment(
    "Sweeps with one worker and with two: trials per second and memory of 200 trials.",
    lambda: ex.grid(jobs=(1, 2)),
    sweep_trial,
    whole=sweep_rows,
    picture=[ex.Curves("trial", "memory of a worker [MB]", limit=_MEMORY)],
    serial=True,
)

_SLOWER = 0.15  # share by which a ratio may grow


def loop_time() -> float:
    """Return the time of a fixed amount of work in Python and NumPy [s]."""
    start, x = wall.perf_counter(), np.eye(7)
    for _ in range(200_000):
        x = x @ x
    return wall.perf_counter() - start


def overhead_trial(scenario: str) -> ex.Measures:
    """Return medians of five runs."""
    loaded, ratios = load_scenario(scenario), []
    for _ in range(5):
        loop, benchmark = loop_time(), run_benchmark(loaded, scenario)
        loop = 0.5 * (loop + loop_time())
        ratios.append((benchmark.total / benchmark.plant, benchmark.total / loop))
    plant, loop = np.median(ratios, axis=0)
    return {"over the bare plant [x]": plant, "over the loop [x]": loop}


def slower(ratio: float) -> float:
    """Return the spread of a ratio."""
    return _SLOWER * ratio


overhead = ex.Experiment(
    "Wall-clock time of a run over that of its bare plant, and of a loop in Python.",
    lambda: ex.grid(scenario=("kitchen", "kitchen_fast")),
    overhead_trial,
    {
        "over the bare plant": ex.number(spread=slower),
        "over the loop": ex.number(spread=slower),
    },
    serial=True,
)
