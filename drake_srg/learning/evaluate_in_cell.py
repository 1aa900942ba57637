"""Judges a policy in the cells of a scenario, where it takes the planner's place."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from drake_srg.cell import MakeCell
from drake_srg.common.exceptions import scenario_errors
from drake_srg.learning.baselines import BUILT_IN
from drake_srg.learning.cell_trials import (
    ONE_SHOT,
    cell_policy,
    check_driver,
    make_planner,
    run_cell_trial,
)
from drake_srg.learning.episodes import EVALUATION, environment_id
from drake_srg.learning.evaluate import check_seeds, sweep_info
from drake_srg.learning.policy import policy_digest
from drake_srg.scenario import draw_scenario, load_tree
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.trial import TrialResult, empty_row
from drake_srg.sweeps.trials import run_missing_trials


def evaluate_in_cell(
    policy: str,
    scenario: str,
    trials: int,
    *,
    out: Path,
    engine: Engine,
    environment: str = ONE_SHOT,
    seed: int = EVALUATION,
    overrides: Iterable[str] = (),
    resume: bool = False,
    progress: bool = False,
    tell: Callable[[str], None] = print,
) -> Any:
    """Run a policy in the cell of a scenario, in place of its planner.

    Args:
        policy: A policy's file or name, or a baseline: `rule` or `random`.
        scenario: Name or path of the scenario.
        trials: Number of trials.
        out: Folder of the rows, as of a sweep.
        engine: Runs the trials; entered here.
        environment: Id of the environment that a baseline is for.
        seed: Of the first trial, at least `EVALUATION`.
        overrides: `KEY=VALUE` each; see `load_scenario`.
        resume: Whether `out` may contain trials of this evaluation.
        progress: Whether to show progress on standard error.
        tell: Receives warnings, one line each.

    Returns:
        All rows, a pyarrow.Table.

    Raises:
        ScenarioError: For bad input, before any trial runs.
        OSError: If the folder cannot be written.
        ImportError: If a package is missing.
    """
    check_seeds(trials, seed)
    overrides = list(overrides)
    tree = load_tree(scenario, overrides)
    # Mistakes show here, not in every trial.
    actor = cell_policy(policy, environment_id(environment), seed)
    drawn = draw_scenario(tree, scenario, seed).scenario
    check_driver(policy, drawn, scenario)
    with scenario_errors(Path(scenario).stem):
        MakeCell(drawn, make_planner=functools.partial(make_planner, actor))
    content = {"environment": actor.environment}
    if policy not in BUILT_IN:
        content["policy_sha256"] = policy_digest(policy)
    info = sweep_info(
        policy, scenario, trials, seed, engine, overrides, {**content, **tree}
    )

    run = functools.partial(run_cell_trial, policy, actor.environment)

    def lost(trial: int, reason: str) -> TrialResult:
        values = draw_scenario(tree, scenario, seed + trial).values
        return TrialResult({**empty_row(seed, trial, reason), **values})

    def submit(trial: int) -> Future[TrialResult]:
        return engine.submit(run, tree, scenario, seed, trial)

    return run_missing_trials(
        info, engine, submit, lost, out=out, resume=resume, progress=progress, tell=tell
    )
