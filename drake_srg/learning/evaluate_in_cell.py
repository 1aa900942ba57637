"""Evaluation of policies that replace the planner of a scenario's cell."""

from __future__ import annotations

import dataclasses as dc
import functools
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.log_format import pose_key, row_to_pose
from drake_srg.learning.cell_planner import OneShotPlanner, PolicyPlanner
from drake_srg.learning.envs.hand_task import MakeMover, joints_at
from drake_srg.learning.envs.rewards import LIFTED
from drake_srg.learning.envs.scenes import DRIVER_TAGS, Workspace
from drake_srg.learning.envs.tasks import GraspOneShotEnv, PickEnv
from drake_srg.learning.episodes import EVALUATION, Act, environment_id
from drake_srg.learning.evaluate import check_seeds, latest_policy
from drake_srg.learning.policy import check_sizes, policy_digest
from drake_srg.learning.rules import BUILT_IN, RANDOM, named_rule, random_policy
from drake_srg.objects.models import known_shape, simple_shape
from drake_srg.scenario import Scenario, draw_scenario, load_tree
from drake_srg.scenario.schema import check_single_arm
from drake_srg.simulation import Result, Simulate
from drake_srg.station import MakeCell
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.sweep import lost_trial, run_missing_trials, sweep_info
from drake_srg.sweeps.trial import TrialResult, run_trial
from drake_srg.types import Failure

# Environments whose policies act in cells.
ONE_SHOT = "drake_srg/GraspOneShot-v0"
_ENVIRONMENTS = {
    ONE_SHOT: GraspOneShotEnv,
    "drake_srg/Pick-v0": PickEnv,
    "drake_srg/KitchenPick-v0": PickEnv,
}


@dc.dataclass(frozen=True)
class CellPolicy:
    """A policy that acts in a cell.

    Attributes:
        act: Returns the action for an observation.
        environment: Id of its environment.
        touch: Whether it sees the fingers' forces.
    """

    act: Act
    environment: str
    touch: bool = True


def run_cell_trial(
    policy: str,
    environment: str,
    tree: Mapping[str, Any],
    origin: str,
    seed: int,
    trial: int,
) -> TrialResult:
    """Run a trial of `drake-srg sweep` in which a policy takes the planner's place.

    `success` means that the object is still up after the shake. Metrics of placing are
    left out. For `policy` and `environment`, see `cell_policy`; for the others, see
    `run_trial`.
    """
    actor = cell_policy(policy, environment, seed + trial)
    simulate = functools.partial(_simulate, actor)
    return run_trial(tree, origin, seed, trial, simulate=simulate)


def cell_policy(policy: str, environment: str, seed: int) -> CellPolicy:
    """Return the policy that acts in a cell.

    Args:
        policy: A policy's file or name, or a baseline.
        environment: Id of the environment of a baseline. If that environment lacks the
            rule, the first one that has it is used. A trained policy names its own.
        seed: Seed of random actions.

    Raises:
        ScenarioError: If the policy cannot be read, or belongs to an environment whose
            policies do not act in cells.
    """
    loaded = None if policy in BUILT_IN else latest_policy(policy)
    if loaded is not None:
        environment = loaded.info.environment
    kind = _ENVIRONMENTS.get(environment)
    if kind is None:
        raise ScenarioError(
            f"{policy}: is for {environment}; "
            f"a scenario's cell takes policies for {', '.join(_ENVIRONMENTS)}"
        )
    if loaded is not None:
        check_sizes(policy, loaded, len(kind.observation_names), len(kind.action_names))
        return CellPolicy(loaded, environment, loaded.info.keywords.get("touch", True))
    if policy == RANDOM:
        return CellPolicy(random_policy(len(kind.action_names), seed), environment)
    names = [environment, *_ENVIRONMENTS]
    rules = {name: named_rule(name, policy) for name in names}
    return next(CellPolicy(rule, name) for name, rule in rules.items() if rule)


def check_driver(policy: str, scenario: Scenario, origin: str) -> None:
    """Check that a cell's gripper has the driver with which a policy was trained.

    Raises:
        ScenarioError: If the cell has another driver.
    """
    known = {tag[1:]: name for name, tag in DRIVER_TAGS.items()}
    own = type(scenario.gripper).__name__
    if own not in known:
        raise ScenarioError(
            f"{origin}: gripper: policies grasp with an SRG, got !{own} "
            f"(allowed: {', '.join(DRIVER_TAGS.values())})"
        )
    if policy in BUILT_IN:
        return
    trained = latest_policy(policy).info.keywords.get("driver", "plant")
    if known[own] != trained:
        raise ScenarioError(
            f"{policy}: was trained with driver={trained}, {origin} has !{own} "
            f"(allowed: --set gripper='{DRIVER_TAGS[trained]} {{}}')"
        )


def make_planner(policy: CellPolicy, scenario: Scenario) -> System:
    """Make a planner that acts by a policy.

    Raises:
        ScenarioError: If the hand does not point down at home or does not reach the
            region, or the localizer does not know the picked object as a single
            cylinder or box.
    """
    assert scenario.arm is not None
    home = scenario.arm.home
    with scenario_errors():
        mover = MakeMover(MakeModelsPlant(scenario), np.array(home))
    name = scenario.task.pick
    shape = known_shape(name, scenario.objects[name])
    if shape is None:
        raise ScenarioError(
            f"objects.{name}: policies grasp single cylinders and boxes that the "
            "localizer knows"
        )
    table = scenario.table.height
    if policy.environment == ONE_SHOT:
        return OneShotPlanner(policy.act, mover, home, name, shape, table)
    workspace = Workspace.of(scenario)
    joints_at(mover, np.array(home), workspace.start)  # fails if it is out of reach
    return PolicyPlanner(
        policy.act,
        mover,
        home,
        name,
        shape,
        table,
        workspace=workspace,
        touch=policy.touch,
    )


def _simulate(policy: CellPolicy, scenario: Scenario, **options: Any) -> Result:
    """Run a cell with a policy; the arguments are those of `Simulate`."""
    result = Simulate(
        scenario, make_planner=functools.partial(make_planner, policy), **options
    )
    failure: str | None = result.metrics.failure
    success = False
    if result.status.done:
        success = is_held(scenario, result)
        failure = None if success else Failure.NO_GRASP.value
    metrics = dc.replace(
        result.metrics,
        success=success,
        failure=failure,
        placement_error_m=None,
        placement_tilt_rad=None,
    )
    return dc.replace(result, metrics=metrics)


def is_held(scenario: Scenario, result: Result) -> bool:
    """Return whether the picked object was up at the end of a run, as in `HandEnv`."""
    name = scenario.task.pick
    shape = simple_shape(name, scenario.objects[name])
    X_WO = row_to_pose(result.log[pose_key(name)][-1])
    if shape is None:
        return False
    down = -X_WO.rotation().matrix()[2]
    height = X_WO.translation()[2] - shape.half_extent(down) - scenario.table.height
    return bool(height >= 0.5 * LIFTED)


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

    The arguments are those of `evaluate`, except for two. `environment`: see
    `cell_policy`. `overrides`: `KEY=VALUE` each; see `load_scenario`.

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
    # Mistakes fail here, not in every trial.
    actor = cell_policy(policy, environment_id(environment), seed)
    drawn = draw_scenario(tree, scenario, seed).scenario
    check_single_arm(drawn, "a policy")
    check_driver(policy, drawn, scenario)
    with scenario_errors(Path(scenario).stem):
        MakeCell(drawn, make_planner=functools.partial(make_planner, actor))
    content = {"environment": actor.environment}
    if policy not in BUILT_IN:
        content["policy_sha256"] = policy_digest(policy)
    whole = {**content, **tree}
    info = sweep_info(scenario, trials, seed, engine, overrides, whole, policy=policy)
    lost = functools.partial(lost_trial, tree, scenario, seed)
    run = functools.partial(run_cell_trial, policy, actor.environment)

    def submit(trial: int) -> Future[TrialResult]:
        return engine.submit(run, tree, scenario, seed, trial)

    return run_missing_trials(
        info, engine, submit, lost, out=out, resume=resume, progress=progress, tell=tell
    )
