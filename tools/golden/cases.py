"""The golden cases: the commands, and the hashes of their results."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

# What depends on the speed of the machine or on the folder. The rest of a run's results
# depends on the scenario and its seed alone.
_WALL = {"planning_wall_s", "wall_time_s", "real_time_factor", "artifacts"}
_WALL_COLUMNS = {"trial_time_s", "memory_mb", "worker"}
QUICK = {
    "run kitchen_fast 0",
    "run assistive_arm_fast 0",
    "run clear_table_fast 0",
    "episode Pick-v0",
    "export sdf",
}


@dc.dataclass(frozen=True)
class Golden:
    """The results of a case.

    Attributes:
        outcome: Results that no machine may change: success, failure and attempts.
        hashes: Hashes by the name of an array, a metric or a file.
    """

    outcome: dict[str, Any]
    hashes: dict[str, str]


@dc.dataclass(frozen=True)
class Case:
    """A run whose results are compared."""

    name: str
    run: Callable[[Path], Golden]


def all_cases() -> list[Case]:
    """Return all cases, the longest first."""
    from drake_srg.scenario import list_scenarios, load_scenario

    cases = []
    for name in list_scenarios():
        scenario = load_scenario(name)
        if scenario.task.pick or scenario.task.clear:
            for seed in (0, 1):
                cases.append(_run_case(name, seed))
    cases.sort(key=lambda case: not case.name.startswith(("run clear", "run sort")))
    for env in ("GraspOneShot", "Pick", "KitchenPick", "KitchenPickPlace"):
        cases.append(_episode_case(f"{env}-v0"))
    cases.append(Case("sweep kitchen_varied", _sweep))
    cases += [_export_case(kind) for kind in ("urdf", "mjcf", "sdf")]
    return cases


def _command(*arguments: str) -> None:
    """Run `drake-srg`; exit code 1, a task that failed, is a result like any other."""
    done = subprocess.run(
        [sys.executable, "-m", "drake_srg", *arguments, "--quiet"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in {0, 1}:
        raise RuntimeError(f"drake-srg {' '.join(arguments)}: {done.stderr.strip()}")


def _run_case(scenario: str, seed: int) -> Case:
    def run(out: Path) -> Golden:
        _command("run", scenario, f"--seed={seed}", "--no-record", f"--out={out}")
        metrics = json.loads((out / "metrics.json").read_text("utf-8"))
        with np.load(out / "log.npz") as log:
            hashes = {name: _array_hash(log[name]) for name in log.files}
        hashes |= {
            key: _hash(json.dumps(value, sort_keys=True).encode())
            for key, value in metrics.items()
            if key not in _WALL
        }
        outcome = {key: metrics[key] for key in ("success", "failure", "attempts")}
        return Golden(outcome, hashes)

    return Case(f"run {scenario} {seed}", run)


def _episode_case(env_id: str) -> Case:
    def run(out: Path) -> Golden:
        # In a process of its own, as the others: nothing that one case does to this
        # process can change the next.
        done = subprocess.run(
            [sys.executable, "-c", _EPISODE, env_id, str(out / "episode.npz")],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{env_id}: {done.stderr.strip()}")
        with np.load(out / "episode.npz") as episode:
            hashes = {name: _array_hash(episode[name]) for name in episode.files}
            return Golden({"steps": len(episode["rewards"])}, hashes)

    return Case(f"episode {env_id}", run)


_EPISODE = """
import sys
import gymnasium
import numpy as np
import drake_srg.learning.envs

env = gymnasium.make(f"drake_srg/{sys.argv[1]}")
generator = np.random.default_rng(0)
observations, rewards, ended = [env.reset(seed=0)[0]], [], False
while not ended:
    action = generator.uniform(env.action_space.low, env.action_space.high)
    observation, reward, done, cut, _ = env.step(action.astype(np.float32))
    observations.append(observation)
    rewards.append(reward)
    ended = done or cut
np.savez(sys.argv[2], observations=np.array(observations), rewards=np.array(rewards))
"""


def _sweep(out: Path) -> Golden:
    import pyarrow.parquet

    _command("sweep", "kitchen_varied", "--trials=1", "--jobs=1", f"--out={out / 's'}")
    (file,) = sorted((out / "s").rglob("*.parquet"))
    (row,) = pyarrow.parquet.read_table(file).to_pylist()
    wall = {key for key in row if "wall" in key or key in _WALL | _WALL_COLUMNS}
    hashes = {k: _hash(repr(v).encode()) for k, v in row.items() if k not in wall}
    return Golden({"success": row["success"]}, hashes)


def _export_case(kind: str) -> Case:
    def run(out: Path) -> Golden:
        folder = out / "models"
        _command("export", "kitchen", f"--{kind}", str(folder))
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        hashes = {
            path.relative_to(folder).as_posix(): _hash(path.read_bytes())
            for path in files
        }
        return Golden({"files": len(files)}, hashes)

    return Case(f"export {kind}", run)


def _array_hash(array: np.ndarray[Any, Any]) -> str:
    head = f"{array.dtype.str}{array.shape}".encode()
    return _hash(head + np.ascontiguousarray(array).tobytes())


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:8]


def run_case(case: Case) -> Golden:
    """Run a case in a temporary folder and return its results."""
    with tempfile.TemporaryDirectory() as folder:
        return case.run(Path(folder))
