"""Evaluation of experts, policies and random actions on tasks of the suite.

    python -m drake_srg.suite.evaluate all --episodes 20 --out out/suite

Each task gets a folder of rows in the folder of `--out`, as from `drake-srg evaluate`,
so `drake-srg report` works on it. Episodes that are already there are not repeated.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import NAMESPACE
from drake_srg.learning.evaluate import evaluate
from drake_srg.learning.policy import load_policy
from drake_srg.learning.rules import RANDOM, RULE
from drake_srg.suite.envs import VECTOR_ENVS
from drake_srg.suite.tasks import EPISODES, find_tasks
from drake_srg.sweeps.engines import Engine, JoblibEngine, usable_cores
from drake_srg.sweeps.statistics import wilson_interval

EXPERT = "expert"
_MODULE = "drake_srg.suite.envs"


def environment_of(task: str, policy: str) -> str:
    """Return the id of the environment in which a policy plays a task.

    Args:
        task: Its name.
        policy: `expert`, `random`, or the file of a policy that was trained in one of
            the task's `VECTOR_ENVS`.

    Raises:
        ScenarioError: If the policy cannot be read, or is for another environment.
    """
    names = {f"{NAMESPACE}{task}_{suffix}-v0" for suffix in VECTOR_ENVS}
    if policy in (EXPERT, RANDOM):
        return f"{_MODULE}:{NAMESPACE}{task}_proprio-v0"
    if not policy.endswith(".npz"):
        raise ScenarioError(
            f"--policy: must be {EXPERT}, {RANDOM} or a .npz file, got {policy!r}"
        )
    environment = load_policy(policy).info.environment
    own = environment.rpartition(":")[2]
    if own not in names:
        raise ScenarioError(f"{policy}: is a policy for {own}, not for {task}")
    return environment


def play_episodes(
    task: str,
    episodes: int,
    *,
    out: Path,
    engine: Engine,
    policy: str = EXPERT,
    episode_length: int | None = None,
) -> Any:
    """Play the first episodes of the split `evaluation` that are not in a folder yet.

    Args:
        task: Its name.
        episodes: Number of episodes.
        out: Folder of the rows; see `drake_srg.learning.evaluate.evaluate`.
        engine: Runs the episodes; entered here.
        policy: See `environment_of`.
        episode_length: Longest episode, in steps; None: the task's.

    Returns:
        All rows, a pyarrow.Table.

    Raises:
        ScenarioError: If there is no such task, the policy is for another one, or the
            folder contains episodes with other settings.
        OSError: If the folder cannot be written.
    """
    find_tasks([task])
    keywords: dict[str, Any] = {"expert": policy == EXPERT}
    if episode_length is not None:
        keywords["episode_length"] = episode_length
    return evaluate(
        RULE if policy == EXPERT else policy,
        environment_of(task, policy),
        episodes,
        out=out,
        engine=engine,
        keywords=keywords,
        resume=True,
        progress=sys.stderr.isatty(),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m drake_srg.suite.evaluate")
    parser.add_argument("tasks", help="names with commas between them, or `all`")
    parser.add_argument(
        "--policy", default=EXPERT, help="`expert`, `random`, or a policy.npz"
    )
    parser.add_argument("--episodes", type=int, default=20, help=f"1 to {EPISODES}")
    parser.add_argument("--episode-length", type=int, help="in steps")
    parser.add_argument("--jobs", type=int, default=usable_cores(), help="at a time")
    parser.add_argument("--out", type=Path, required=True, help="a folder")
    options = parser.parse_args(arguments)
    if not 1 <= options.episodes <= EPISODES:
        parser.error(f"--episodes: must be 1 to {EPISODES}, got {options.episodes}")
    for name, value in (
        ("--episode-length", options.episode_length),
        ("--jobs", options.jobs),
    ):
        if value is not None and value < 1:
            parser.error(f"{name}: must be at least 1, got {value}")
    try:
        names = find_tasks(options.tasks)
        for name in names:
            environment_of(name, options.policy)
        for name in names:
            rows = play_episodes(
                name,
                options.episodes,
                out=options.out / name,
                engine=JoblibEngine(options.jobs),
                policy=options.policy,
                episode_length=options.episode_length,
            )
            done = sum(rows["success"].to_pylist())
            low, high = wilson_interval(done, rows.num_rows)
            shares = f"{100 * low:.1f} % to {100 * high:.1f} %"
            print(f"{name:20} {done} of {rows.num_rows} ({shares})", flush=True)
    except (ScenarioError, OSError) as error:
        print(f"drake_srg.suite.evaluate: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
