import pytest

from drake_srg.experiments import known_models
from drake_srg.experiments.known_models import MODELS, overrides_of, run
from drake_srg.experiments.known_shapes import SCENARIO
from drake_srg.experiments.registry import quiet
from drake_srg.objects.solids import planned_solid
from drake_srg.scenario import load_scenario
from drake_srg.types import Box, Cylinder, Sphere
from experiments.made_cycles import metrics


@pytest.mark.parametrize("case", MODELS)
def test_the_planner_knows_each_by_its_pieces_alone(case):
    first, second = (
        load_scenario(SCENARIO, seed=seed, overrides=overrides_of(case))
        for seed in (1, 2)
    )
    name = first.task.pick
    config = first.objects[name]
    assert not isinstance(planned_solid(name, config), Box | Cylinder | Sphere)
    assert config.yaw != second.objects[name].yaw
    assert config.color_range.space == "hsv"


def test_runs_every_object_and_keeps_its_trials(monkeypatch, tmp_path):
    seen = []

    def fake(scenario, overrides, seed):
        seen.append(seed)
        return vars(metrics())

    monkeypatch.setattr(known_models, "run_trial", fake)
    keep = str(tmp_path / "trials")
    result = run(quiet, trials=2, seed=7, keep=keep)
    assert seen == [7] * len(MODELS) + [8] * len(MODELS)
    assert len(result.tables["trials"]["case"]) == 2 * len(MODELS)
    assert all(row.passed for row in result.rows)
    run(quiet, trials=2, seed=7, keep=keep)
    assert len(seen) == 2 * len(MODELS)
