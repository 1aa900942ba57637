"""The commands `drake-srg train` and `drake-srg evaluate`."""

import argparse
import functools
import json
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from drake_srg.cli.command import (
    INTERRUPTED,
    SUCCESS,
    argument,
    command,
    flag,
    repeatable,
    resuming,
    warn,
)
from drake_srg.cli.results import SWEEP, TRAINING, folder, results_folder
from drake_srg.cli.sweep import ENGINE, make_engine
from drake_srg.common.exceptions import ScenarioError

_SET = "a keyword of the environment (repeatable) in YAML, such as driver=tendon"


@command(
    "learn to grasp: train a policy in an environment",
    "It writes the policy that does best in validation episodes as policy.npz. It "
    "needs the extra `learn`.",
    argument(
        "environment",
        metavar="ENV",
        help="an environment, such as GraspOneShot, or any Gymnasium ID",
    ),
    argument(
        "--algo",
        choices=("q", "sac", "bc", "dagger"),
        default="q",
        metavar="NAME",
        help="the algorithm: q: action values, for episodes of one step; sac: soft "
        "actor-critic; bc: clone a hand-written rule, or --data; dagger: also ask the "
        "rule in states that the clone reaches (default: %(default)s)",
    ),
    argument(
        "--data",
        type=Path,
        metavar="DIR",
        help="for bc: clone the grasps in a data set of `drake-srg dataset`",
    ),
    argument(
        "--rule",
        choices=("rule", "touch"),
        default="rule",
        metavar="NAME",
        help="for bc and dagger: the hand-written rule to imitate; touch: the one that "
        "finds objects by touch (default: %(default)s)",
    ),
    argument(
        "--steps",
        type=int,
        default=2000,
        metavar="N",
        help="steps of the environment (default: %(default)s)",
    ),
    argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="a number from 0 to 999 (default: 0)",
    ),
    repeatable("--set", "KEY=VALUE", _SET),
    argument(
        "--validation",
        type=int,
        default=50,
        metavar="N",
        help="number of validation episodes (default: %(default)s)",
    ),
    folder("policy.npz and the log", "out/train/ENV"),
    flag("--resume", "continue the training in DIR"),
)
def train(options: argparse.Namespace) -> int:
    """Train a policy, and print its score and path; return the exit code.

    Raises:
        ScenarioError: For bad input, or if the folder cannot be written.
        ImportError: If a package is missing.
    """
    from drake_srg.learning.train import POLICY, Training
    from drake_srg.learning.train import train as run_training

    words = ["drake-srg", "train", options.environment, "--algo", options.algo]
    words += ["--steps", str(options.steps), "--seed", str(options.seed)]
    words += [word for item in options.set for word in ("--set", item)]
    words += ["--validation", str(options.validation)]
    words += [] if options.data is None else ["--data", str(options.data)]
    words += [] if options.rule == "rule" else ["--rule", options.rule]
    if options.validation < 1:
        raise ScenarioError(f"--validation {options.validation}: must be at least 1")
    training = Training(
        environment=options.environment,
        keywords=keywords(options.set),
        algorithm=options.algo,
        steps=options.steps,
        seed=options.seed,
        validation=options.validation,
        command=shlex.join(words),
        data="" if options.data is None else str(options.data),
        rule=options.rule,
    )
    default = Path("out") / "train" / _stem(options.environment)
    out = default
    try:
        with results_folder(options, default, TRAINING) as out:
            policy = run_training(
                training, out, resume=options.resume, progress=options.console.progress
            )
    except KeyboardInterrupt:
        options.console.complain(f"stopped; to continue: {resuming(options, out)}")
        return INTERRUPTED
    info = policy.info
    options.console.say(
        f"{info.scores['validation']:.0%} of validation episodes succeed after "
        f"{info.steps} steps",
        out / POLICY,
    )
    options.console.answer(
        {"policy": out / POLICY, "steps": info.steps, "scores": info.scores}
    )
    return SUCCESS


@command(
    "run a policy in many episodes, next to a rule and to chance",
    "Training uses none of these episodes. Exit code: 0 once all have run.",
    argument(
        "policy",
        metavar="POLICY",
        help="a policy.npz, the name of a policy of the package, rule, touch or random",
    ),
    argument(
        "environment",
        metavar="ENV",
        help="an environment, or a scenario in whose cell the policy is the planner",
    ),
    argument(
        "--trials", type=int, required=True, metavar="N", help="number of episodes"
    ),
    argument(
        "--seed",
        type=int,
        metavar="N",
        help="seed of the first episode",
    ),
    repeatable("--set", "KEY=VALUE", f"{_SET}; of a scenario, any entry"),
    ENGINE,
    folder("the results", "out/evaluate/ENV"),
    flag("--resume", "continue the evaluation in DIR"),
    flag("--no-baselines", "run only the policy, without rule and random actions"),
    flag("--report", "also write DIR/POLICY/report.html"),
)
def evaluate(options: argparse.Namespace) -> int:
    """Run a policy and the baselines, and print how often each succeeds.

    Raises:
        ScenarioError: For bad input, or if the folder cannot be written.
        ImportError: If a package is missing.
    """
    from drake_srg.learning.rules import BASELINES, BUILT_IN, RULE
    from drake_srg.sweeps.report.write import write_report
    from drake_srg.sweeps.statistics import wilson_interval

    names = [options.policy]
    if not options.no_baselines:
        names += [name for name in BASELINES if name != options.policy]
    run_evaluation = _evaluation(options)
    answer: dict[str, Any] = {}
    table = [("", "succeeded", "share", "95 % interval (Wilson)")]
    files: list[Path] = []
    default = Path("out") / "evaluate" / _stem(options.environment)
    parts = {name: name if name in BUILT_IN else "policy" for name in names}
    patterns = [f"{part}/{name}" for part in parts.values() for name in SWEEP]
    with results_folder(options, default, patterns) as out:
        for name, part in parts.items():
            try:
                rows = run_evaluation(
                    name,
                    options.environment,
                    options.trials,
                    out=out / part,
                    engine=make_engine(options),
                    resume=options.resume,
                    progress=options.console.progress,
                    tell=warn,
                )
            except ScenarioError as error:
                if name == RULE != options.policy and "has no hand-written" in str(
                    error
                ):
                    continue  # an environment of another package
                raise
            files.append(out / part / "trials.parquet")
            if options.report:
                files.append(write_report(out / part))
            done, count = sum(rows["success"].to_pylist()), rows.num_rows
            low, high = wilson_interval(done, count)
            shown = f"{low:.1%} to {high:.1%}"
            table.append((name, f"{done} of {count}", f"{done / count:.1%}", shown))
            answer[name] = {"succeeded": done, "trials": count, "interval": [low, high]}
    options.console.say(*_aligned(table), "", *files)
    options.console.answer({"policies": answer, "files": files})
    return SUCCESS


def _evaluation(options: argparse.Namespace) -> Callable[..., Any]:
    """Return the function that evaluates in the given environment or scenario."""
    from drake_srg.learning.episodes import EVALUATION
    from drake_srg.learning.policy import load_policy
    from drake_srg.learning.rules import BUILT_IN
    from drake_srg.scenario.load import is_scenario

    seed = EVALUATION if options.seed is None else options.seed
    if is_scenario(options.environment):
        from drake_srg.learning.evaluate_in_cell import (
            ONE_SHOT,
            cell_policy,
            evaluate_in_cell,
        )

        return functools.partial(
            evaluate_in_cell,
            # Baselines act in the same way as the policy.
            environment=cell_policy(options.policy, ONE_SHOT, seed).environment,
            seed=seed,
            overrides=options.set,
        )
    from drake_srg.learning.evaluate import evaluate

    given = keywords(options.set)
    if options.policy not in BUILT_IN:  # baselines get the policy's keywords, too
        given = {**load_policy(options.policy).info.keywords, **given}
    return functools.partial(evaluate, seed=seed, keywords=given)


def keywords(items: Sequence[str]) -> dict[str, Any]:
    """Return the keywords of `--set KEY=VALUE` options.

    Raises:
        ScenarioError: If an option has no `=`, or its value is not YAML.
    """
    from drake_srg.scenario.typed_yaml import parse_yaml

    found: dict[str, Any] = {}
    for item in items:
        key, equals, value = item.partition("=")
        if not (key and equals):
            raise ScenarioError(f"--set {item}: must be KEY=VALUE")
        tree = parse_yaml(f"{key}: {value}", f"--set {item}")
        try:
            json.dumps(tree)  # files of results have the keywords as JSON
        except TypeError:
            tree = None
        if not isinstance(tree, dict):
            raise ScenarioError(f"--set {item}: must be KEY=VALUE, without dates")
        found |= tree
    return found


def _stem(environment: str) -> str:
    return Path(environment).stem.partition("-v")[0]


def _aligned(table: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return ["  ".join(map(str.ljust, line, widths)).rstrip() for line in table]
