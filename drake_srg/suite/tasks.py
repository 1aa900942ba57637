"""Tasks of the suite, read from tasks.yaml, and the seeds of their episodes."""

import dataclasses as dc
import functools
from collections.abc import Iterable
from pathlib import Path

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.config import Config, positive
from drake_srg.learning.episodes import EVALUATION
from drake_srg.scenario.typed_yaml import load_typed, parse_yaml

FILE = Path(__file__).with_name("tasks.yaml")
# Number of evaluation episodes per task.
EPISODES = 200
EVALUATION_SPLIT, TRAINING_SPLIT = "evaluation", "training"
SPLITS = (EVALUATION_SPLIT, TRAINING_SPLIT)
GOALS = ("lift", "place", "clear")
EXPERTS = ("planner", "touch")


@dc.dataclass(kw_only=True)
class Task(Config):
    """A task of the suite.

    Attributes:
        scenario: Name of the task's scenario.
        set: Changes to the scenario, `KEY=VALUE` each, as for `--set`.
        goal: Condition of success: `lift`, the picked object is 5 cm higher than at
            the start; `place`, it rests on its goal; `clear`, all objects rest in their
            bins or at their places in the row.
        wordings: Three descriptions of the task in plain words.
        varied: Description of what varies between episodes.
        seconds: Longest episode [s].
        expert: `planner`, the scenario's own, or `touch`, the rule that searches by
            touch.
    """

    scenario: str = ""
    set: list[str] = dc.field(default_factory=list)
    goal: str = dc.field(default="place", metadata={"among": GOALS})
    wordings: list[str] = dc.field(
        default_factory=lambda: ["", "", ""], metadata={"length": 3}
    )
    varied: str = ""
    seconds: float = dc.field(default=20.0, metadata=positive())
    expert: str = dc.field(default="planner", metadata={"among": EXPERTS})

    @property
    def picks(self) -> bool:
        """Whether the task is about one object, not all."""
        return self.goal != "clear"


@functools.cache
def load_tasks() -> dict[str, Task]:
    """Return the tasks of the suite by name, in their order."""
    tree = parse_yaml(FILE.read_text(encoding="utf-8"), FILE.name)
    return {
        name: load_typed(Task, entry, f"{FILE.name}: {name}")
        for name, entry in tree.items()
    }


def find_tasks(names: str | Iterable[str]) -> list[str]:
    """Return the names of tasks.

    Args:
        names: Names, or a string of names separated by commas; `all` means all tasks.

    Raises:
        ScenarioError: If a name is unknown or repeated, or there are no names.
    """
    parts = names.split(",") if isinstance(names, str) else list(names)
    found = [name.strip() for name in parts if name.strip()]
    known = list(load_tasks())
    if found == ["all"]:
        return known
    for name in found:
        if name not in known:
            raise ScenarioError(f"task: unknown {name!r} {suggest(name, known)}")
        if found.count(name) > 1:
            raise ScenarioError(f"task: {name!r} is repeated")
    if not found:
        raise ScenarioError(f"task: must name a task (allowed: {', '.join(known)})")
    return found


def scenario_seed(split: str, episode: int) -> int:
    """Return the seed of an episode's scenario.

    Evaluation has `EPISODES` seeds, which training cannot use. Its episode 200 is
    episode 0 again.

    Args:
        split: `evaluation` or `training`.
        episode: Its number, from 0.

    Raises:
        ScenarioError: If the number is negative, or training has no such episode.
    """
    if episode < 0:
        raise ScenarioError(f"seed: must be at least 0, got {episode}")
    if split == EVALUATION_SPLIT:
        return EVALUATION + episode % EPISODES
    if episode >= EVALUATION:
        raise ScenarioError(
            f"seed: {episode} is out of range (allowed: 0 to {EVALUATION - 1})"
        )
    return episode
