"""Plays tasks of the suite with their experts, or with random actions.

    python -m drake_srg.suite.evaluate all --episodes 20 --out out/suite.jsonl

The file gets a line of JSON per episode; those that it has are not played again. Give
`--policy random` a file of its own.
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
from drake_srg.suite.env import SuiteEnv
from drake_srg.suite.tasks import EPISODES, EVALUATION_SPLIT, SPLITS, find_tasks
from drake_srg.sweeps.statistics import wilson_interval

EXPERT, RANDOM = "expert", "random"


def evaluate_expert(
    task: str,
    episodes: Sequence[int],
    *,
    policy: str = EXPERT,
    split: str = EVALUATION_SPLIT,
) -> Iterator[dict[str, Any]]:
    """Play episodes of a task, and yield a row for each.

    A row has `task`, `episode`, `policy`, `success`, `failure`, why the simulator gave
    up, `expert`, what the expert says of itself, `steps` and `wall_s`.

    Args:
        task: Its name.
        episodes: Numbers of the episodes.
        policy: `expert`, or `random` for actions drawn evenly from the action space.
        split: `evaluation` or `training`.

    Raises:
        ScenarioError: If there is no such task.
    """
    expert = policy == EXPERT
    env = SuiteEnv(task, split=split, cameras=(), render_mode=None, expert=expert)
    for episode in episodes:
        begun = wall.perf_counter()
        # The environment draws from the number itself.
        rng = np.random.default_rng([episode, 1])
        space = env.actions
        _, info = env.reset(seed=episode)
        steps, ended = 0, False
        while not ended:
            action = (
                env.expert_action()
                if expert and not info["failure"]
                else rng.uniform(space.low, space.high).astype(np.float32)
            )
            *_, terminated, truncated, info = env.step(action)
            steps, ended = steps + 1, terminated or truncated
        said = ""
        if expert and not info["failure"]:
            status = env.episode.status
            said = f"{status.mode}" if status.failure is None else f"{status.failure}"
        yield {
            "task": task,
            "episode": episode,
            "policy": policy,
            "success": info["is_success"],
            "failure": info["failure"],
            "expert": said,
            "steps": steps,
            "wall_s": round(wall.perf_counter() - begun, 1),
        }
    env.close()


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a file; none if there is no file.

    Raises:
        ScenarioError: If a line is no row.
    """
    if not path.exists():
        return []
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            row = json.loads(line)
            row["task"], row["episode"], row["success"]
        except (ValueError, KeyError, TypeError):
            raise ScenarioError(f"{path}:{number}: is no row of an episode") from None
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
    parser.add_argument("--policy", choices=(EXPERT, RANDOM), default=EXPERT)
    parser.add_argument("--episodes", type=int, default=20, help=f"1 to {EPISODES}")
    parser.add_argument("--split", choices=SPLITS, default=EVALUATION_SPLIT)
    parser.add_argument("--out", type=Path, required=True, help="a file of rows")
    options = parser.parse_args(arguments)
    if not 1 <= options.episodes <= EPISODES:
        parser.error(f"--episodes: must be 1 to {EPISODES}, got {options.episodes}")
    try:
        names = find_tasks(options.tasks)
        rows = read_rows(options.out)
        options.out.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(options.out.open("a", encoding="utf-8"))
            for name in names:
                done = {row["episode"] for row in rows if row["task"] == name}
                todo = [i for i in range(options.episodes) if i not in done]
                for row in evaluate_expert(
                    name, todo, policy=options.policy, split=options.split
                ):
                    rows.append(row)
                    file.write(json.dumps(row) + "\n")
                    file.flush()
    except (ScenarioError, OSError) as error:
        print(f"drake_srg.suite.evaluate: {error}", file=sys.stderr)
        return 2
    print(table([row for row in rows if row["task"] in names]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
