"""The cost of work on this machine: motions, recording, and sweeps.

* `time_parameterization` compares toppra, which all planners use, with Drake's own
  solver, for motions of the kitchen's arm.
* `recording_cost` is the processor time of all threads in a worker of a sweep, relative
  to an unrecorded trial. Rendering and linear algebra have one thread each. The time
  varies by a tenth between equal runs.
* `sweep_throughput` is the real time of a whole sweep with one worker and with two,
  including checks and the start of the workers. It needs an otherwise idle machine with
  at least two cores.
* `overhead` is what `make bench-guard` runs: a scenario's real time, divided by that of
  its bare plant on the same inputs, and by that of a loop in Python. On a slow machine,
  all of them slow down together.
"""

import tempfile
import time as wall
from pathlib import Path

import numpy as np
from pydrake.multibody.optimization import Toppra
from pydrake.trajectories import BsplineTrajectory, Trajectory

import experiments.runner as ex
from drake_srg import Simulate, load_scenario
from drake_srg.lifetime import free_diagrams
from drake_srg.planning.motion.arm_model import ArmModel
from drake_srg.planning.motion.limits import MotionLimits
from drake_srg.planning.motion.time_parameterization import load_toppra
from drake_srg.planning.motion.trajectories import grid_of, rounded_path
from drake_srg.simulation.benchmark import run_benchmark
from drake_srg.station import MakeTaskPlanner
from drake_srg.sweeps.engines import JoblibEngine
from drake_srg.sweeps.sweep import run_sweep
from drake_srg.types import Vector

SOLVERS = ("toppra", "drake")
SPANS = (8, 32, 64)  # of the paths


def solve_with_drake(
    arm: ArmModel, path: BsplineTrajectory, limits: MotionLimits, grid: Vector
) -> Trajectory | None:
    """Do the same as `toppra_parameterization`.

    The motion may exceed the acceleration limit at the last point of the grid.
    """
    # Drake's solver takes the positions of the whole plant.
    control = [arm.positions(point[:, 0])[:, None] for point in path.control_points()]
    whole = BsplineTrajectory(path.basis(), control)  # the solver does not keep it
    solver = Toppra(whole, arm.plant, grid)
    for add, limit in (
        (solver.AddJointVelocityLimit, limits.velocity),
        (solver.AddJointAccelerationLimit, limits.acceleration),
        (solver.AddJointTorqueLimit, limits.torque),
    ):
        bound = np.full(arm.plant.num_positions(), 1e6)  # loose for fixed joints
        bound[arm.arm_indices] = np.minimum(limit, 1e6)
        add(-bound, bound)
    return solver.SolvePathParameterization()


def path_trial(paths: int) -> ex.Measures:
    """Time motions along random polylines of the kitchen's arm by both solvers."""
    planner = MakeTaskPlanner(load_scenario("kitchen", seed=0))
    scene, random = planner.scene, np.random.default_rng(0)
    limits, grids = MotionLimits.of_plant(scene), []
    solvers = (load_toppra(), solve_with_drake)  # as in SOLVERS
    durations, times = np.full((2, len(solvers), paths), np.nan)
    for i in range(paths):
        first, second = random.uniform(-0.6, 0.6, (2, scene.num_joints))
        # Drake's finds no motion along some paths that turn back.
        second *= np.sign(first @ second)
        waypoints = planner.q_home + np.array([0.0 * first, first, first + second])
        path, _ = rounded_path(waypoints, SPANS[i % len(SPANS)])
        grid = grid_of(path)
        grids.append(len(grid))
        for k, parameterize in enumerate(solvers):
            tries = []
            for _ in range(3):  # the fastest counts
                start = wall.perf_counter()
                progress = parameterize(scene, path, limits, grid)
                tries.append(wall.perf_counter() - start)
            times[k, i] = 1e3 * min(tries)
            if progress is not None:
                durations[k, i] = progress.end_time()
    toppra, drake = durations
    return {
        "grids": grids,
        "times": times,
        "Drake: duration [s]": drake,
        "toppra: duration [s]": toppra,
    }


def path_rows(trials: ex.Trials) -> dict[str, ex.Values]:
    (t,) = trials
    ratios, alike = t["toppra: duration [s]"] / t["Drake: duration [s]"], {}
    for word, share in (("smallest", 0.0), ("median", 0.5), ("largest", 1.0)):
        value = np.quantile(ratios, share)
        alike[f"duration, {word} ratio []"] = (value, ex.within(1.0, absolute=0.05))
    found: dict[str, ex.Values] = {"all paths": alike}
    for grid in np.unique(t["grids"]):
        own = t["times"][:, t["grids"] == grid]
        # Python and C++ do not slow down alike on a busy machine.
        ratio = (np.median(own[0] / own[1]), ex.at_most(1.0, spread=0.3))
        found[f"{grid} grid points"] = {"wall time, median ratio []": ratio} | {
            f"wall time, {solver}, median [ms]": (time, ex.number(clock="time"))
            for solver, time in zip(SOLVERS, np.median(own, axis=1), strict=True)
        }
    return found


time_parameterization = ex.Experiment(
    "Motions of the kitchen's arm by toppra and by Drake: durations and speed.",
    lambda: [{"paths": 60}],
    path_trial,
    whole=path_rows,
    picture=[ex.Points("Drake: duration [s]", "toppra: duration [s]", equal=True)],
    serial=True,
)

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


VARIES = ex.number(spread=lambda cost: 0.2 * cost)  # costs that vary by a tenth
recording_cost = ex.Experiment(
    "Cost of recording a trial of a sweep, part by part, over an unrecorded one.",
    lambda: ex.grid(scenario=("kitchen_varied", "assistive_arm_varied")),
    recording_trial,
    {
        **dict.fromkeys(PARTS, VARIES),
        "everything": ex.at_most(
            3.0, spread=VARIES.spread, known="images take most of it"
        ),
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


def loop_time() -> float:
    """Return the time of a fixed amount of work in Python and NumPy [s]."""
    start, x = wall.perf_counter(), np.eye(7)
    for _ in range(200_000):
        x = x @ x
    return wall.perf_counter() - start


def overhead_trial(scenario: str) -> ex.Measures:
    loaded, ratios = load_scenario(scenario), []
    for _ in range(5):
        loop, benchmark = loop_time(), run_benchmark(loaded, scenario)
        loop = 0.5 * (loop + loop_time())
        ratios.append((benchmark.total / benchmark.plant, benchmark.total / loop))
    plant, loop = np.median(ratios, axis=0)
    return {"over the bare plant [x]": plant, "over the loop [x]": loop}


overhead = ex.Experiment(
    "Wall-clock time of a run over that of its bare plant, and of a loop in Python.",
    lambda: ex.grid(scenario=("kitchen", "kitchen_fast")),
    overhead_trial,
    dict.fromkeys(
        ("over the bare plant", "over the loop"),
        ex.number(spread=lambda ratio: 0.15 * ratio),
    ),
    serial=True,
)
