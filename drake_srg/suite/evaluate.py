"""Plays tasks of the suite with their experts, a policy's file, or random actions.

    python -m drake_srg.suite.evaluate all --episodes 20 --out out/suite.jsonl

The file gets a line of JSON per episode; those that it has are not played again. Each
`--policy`, `--split` and `--episode-length` needs a file of its own.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time as wall
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_srg.common.exceptions import ScenarioError
from drake_srg.learning.episodes import EVALUATION, NAMESPACE
from drake_srg.learning.policy import (
    Policy,
    check_sizes,
    load_policy,
    policy_digest,
)
from drake_srg.suite.env import SuiteEnv
from drake_srg.suite.envs import VECTOR_ENVS, ProprioceptionEnv
from drake_srg.suite.tasks import (
    EPISODES,
    EVALUATION_SPLIT,
    SPLITS,
    find_tasks,
    scenario_seed,
)
from drake_srg.sweeps.statistics import wilson_interval
from drake_srg.sweeps.trial import resident_memory

EXPERT, RANDOM = "expert", "random"
# The entries of a row that are read again.
_KINDS = {"task": str, "episode": int, "policy": str, "success": bool}


def play_episodes(
    task: str,
    episodes: Sequence[int],
    *,
    policy: str = EXPERT,
    split: str = EVALUATION_SPLIT,
    episode_length: int | None = None,
) -> Iterator[dict[str, Any]]:
    """Play episodes of a task, and yield a row for each.

    A row has the arguments, with `digest`, which tells policies of one name apart;
    `success`; `failure`, why the simulator gave up; `expert`, what the expert says of
    itself; `steps`, `wall_s` and `memory_mb`, the process's resident memory.

    Args:
        task: Its name.
        episodes: Numbers of the episodes.
        policy: `expert`, `random` for actions drawn evenly from the action space, or
            the file of a policy that was trained in one of the task's `VECTOR_ENVS`.
        split: `evaluation` or `training`.
        episode_length: Longest episode, in steps; None: the task's.

    Raises:
        ScenarioError: If there is no such task, or the policy is not for it.
    """
    expert = policy == EXPERT
    played: Policy | None = None
    env: Any
    if policy not in (EXPERT, RANDOM):
        played, kind = _policy_of(policy, task)
        env = kind(task, episode_length=episode_length)
        sizes = env.observation_space.shape[0], env.action_space.shape[0]
        check_sizes(policy, played, *sizes)
    else:
        env = SuiteEnv(
            task,
            split=split,
            cameras=(),
            render_mode=None,
            expert=expert,
            episode_length=episode_length,
        )
    settings = _settings(policy, split, episode_length)
    with contextlib.closing(env):
        for episode in episodes:
            begun = wall.perf_counter()
            # The environment draws from the number itself.
            rng = np.random.default_rng([episode, 1])
            space = env.action_space
            seed = episode if played is None else scenario_seed(split, episode)
            observation, info = env.reset(seed=seed)
            steps, ended = 0, False
            while not ended:
                if played is not None:
                    action = played(observation)
                elif expert and not info["failure"]:
                    action = env.expert_action()
                else:
                    action = rng.uniform(space.low, space.high).astype(np.float32)
                observation, _, terminated, truncated, info = env.step(action)
                steps, ended = steps + 1, terminated or truncated
            said = ""
            if expert and not info["failure"]:
                status = env.episode.status
                said = str((status.failure or status.mode).value)
            yield {
                "task": task,
                "episode": episode,
                **settings,
                "success": bool(info["is_success"]),
                "failure": info["failure"],
                "expert": said,
                "steps": steps,
                "wall_s": round(wall.perf_counter() - begun, 1),
                "memory_mb": resident_memory(),
            }


def _settings(
    policy: str, split: str, episode_length: int | None
) -> dict[str, str | int | None]:
    """Return the part of a row that all rows of a file share.

    Raises:
        ScenarioError: If the policy's file cannot be read.
    """
    own = policy not in (EXPERT, RANDOM)
    return {
        "policy": policy,
        "digest": policy_digest(policy)[:12] if own else "",
        "split": split,
        "episode_length": episode_length,
    }


def _policy_of(file: str, task: str) -> tuple[Policy, type[ProprioceptionEnv]]:
    """Return a policy for a task, and the kind of its environment.

    Raises:
        ScenarioError: If it cannot be read, or is for another environment.
    """
    if not file.endswith(".npz"):
        raise ScenarioError(
            f"--policy: must be {EXPERT}, {RANDOM} or a .npz file, got {file!r}"
        )
    policy = load_policy(file)
    own = policy.info.environment.rpartition(":")[2]
    for suffix, kind in VECTOR_ENVS.items():
        if own == f"{NAMESPACE}{task}_{suffix}-v0":
            return policy, kind
    raise ScenarioError(f"{file}: is a policy for {own}, not for {task}")


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a file; none if there is no file.

    Raises:
        ScenarioError: If a line is no row.
    """
    if not path.exists():
        return []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: is no file of rows") from None
    rows = []
    for number, line in enumerate(lines, 1):
        try:
            row = json.loads(line)
            whole = all(type(row[key]) is kind for key, kind in _KINDS.items())
        except (ValueError, KeyError, TypeError):
            whole = False
        if not whole:
            raise ScenarioError(f"{path}:{number}: is no row of an episode")
        rows.append(row)
    return rows


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the successes of each task as text, with Wilson's 95 % intervals."""
    lines = []
    for task in dict.fromkeys(row["task"] for row in rows):
        own = [row["success"] for row in rows if row["task"] == task]
        low, high = wilson_interval(sum(own), len(own))
        lines.append(
            f"{task:20} {sum(own)} of {len(own)} ({100 * low:.1f} % to "
            f"{100 * high:.1f} %)"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m drake_srg.suite.evaluate")
    parser.add_argument("tasks", help="names with commas between them, or `all`")
    parser.add_argument(
        "--policy", default=EXPERT, help="`expert`, `random`, or a policy.npz"
    )
    parser.add_argument(
        "--episodes", type=int, default=20, help=f"1 to {EPISODES}; more in `training`"
    )
    parser.add_argument("--split", choices=SPLITS, default=EVALUATION_SPLIT)
    parser.add_argument("--episode-length", type=int, help="in steps")
    parser.add_argument("--out", type=Path, required=True, help="a file of rows")
    options = parser.parse_args(arguments)
    most = EPISODES if options.split == EVALUATION_SPLIT else EVALUATION
    if not 1 <= options.episodes <= most:
        parser.error(f"--episodes: must be 1 to {most}, got {options.episodes}")
    length = options.episode_length
    if length is not None and length < 1:
        parser.error(f"--episode-length: must be at least 1, got {length}")
    try:
        names = find_tasks(options.tasks)
        if options.policy not in (EXPERT, RANDOM):
            for name in names:
                _policy_of(options.policy, name)
        rows = read_rows(options.out)
        settings = _settings(options.policy, options.split, length)
        for row in rows:
            for key, value in settings.items():
                if row.get(key) != value:
                    raise ScenarioError(
                        f"{options.out}: has rows of {key} {row.get(key)!r}, not "
                        f"{value!r}; choose another --out"
                    )
        options.out.parent.mkdir(parents=True, exist_ok=True)
        with options.out.open("a", encoding="utf-8") as file:
            for name in names:
                done = {row["episode"] for row in rows if row["task"] == name}
                todo = [i for i in range(options.episodes) if i not in done]
                for row in play_episodes(
                    name,
                    todo,
                    policy=options.policy,
                    split=options.split,
                    episode_length=length,
                ):
                    rows.append(row)
                    file.write(json.dumps(row) + "\n")
                    file.flush()
    except (ScenarioError, OSError) as error:
        print(f"drake_srg.suite.evaluate: {error}", file=sys.stderr)
        return 2
    asked = [row for row in rows if row["episode"] < options.episodes]
    print(table([row for row in asked if row["task"] in names]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
