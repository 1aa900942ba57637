"""Running an experiment: cases, keeping, resuming, results."""

import json

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from experiments import find_experiments
from experiments.runner import run as runner
from experiments.runner.run import Kept, decode, encode, find_experiment, run_experiment


def test_experiments_are_found_without_importing_them():
    found = find_experiments()
    assert list(found) == sorted(found)
    assert found["payload_pinch"].module == "experiments.payload"
    assert all(entry.description.endswith(".") for entry in found.values())


@pytest.mark.parametrize("name", sorted(find_experiments()))
def test_every_experiment_has_cases_and_described_parameters(name):
    experiment = find_experiment(name)
    assert all(text for _, text in experiment.parameters().values())
    cases = list(experiment.cases(**experiment.values(name, [])))
    assert cases
    keys = [json.dumps(encode(case)) for case in cases]
    assert len(set(keys)) == len(keys)  # or one would be taken for another


def test_a_result_has_rows_a_table_and_a_picture(fake, tmp_path):
    fake()
    result = run_experiment("fake_half", tmp_path / "out", workers=1)
    (row,) = result.rows
    assert (row.name, row.quantity, row.measured) == ("half", "of 2", 2.0)
    assert [path.name for path in result.files] == [
        *("result.json", "trials.csv", "fake_half.png")
    ]
    (saved,) = json.loads((tmp_path / "out/result.json").read_text())
    assert saved == row.as_dict()
    lines = (tmp_path / "out/trials.csv").read_text().splitlines()
    assert lines == [*("kind,length,count,part,none", "half,2,2,1,", "half,4,2,2,")]


def test_equal_runs_write_equal_bytes(fake, tmp_path):
    fake()
    for folder in ("a", "b"):
        run_experiment("fake_half", tmp_path / folder, workers=1)
    for name in ("result.json", "trials.csv", "fake_half.png"):
        first, second = ((tmp_path / f / name).read_bytes() for f in ("a", "b"))
        assert first == second


def test_an_interrupted_run_goes_on(fake, tmp_path):
    out = tmp_path / "out"
    ran = fake(largest=3.0)
    with pytest.raises(KeyboardInterrupt):
        run_experiment("fake_half", out, workers=1)
    assert ran() == [2.0, 4.0]
    assert not (out / "result.json").exists()
    ran = fake()
    assert run_experiment("fake_half", out, workers=1).passed
    assert ran() == [4.0]


def test_other_code_runs_again_unless_told_otherwise(fake, tmp_path, monkeypatch):
    ran = fake()
    run_experiment("fake_half", tmp_path, workers=1)
    monkeypatch.setattr(runner, "code_of", lambda name: "other")
    run_experiment("fake_half", tmp_path, workers=1, any_code=True)
    assert len(ran()) == 2
    run_experiment("fake_half", tmp_path, workers=1)
    assert len(ran()) == 4


def test_a_line_that_was_cut_off_runs_again(tmp_path):
    kept = Kept(tmp_path, "c0de")
    kept.add({"seed": 0}, {"x": 1})
    with (tmp_path / "trials.jsonl").open("a") as file:
        file.write('{"case": "{\\"seed\\": 1}", "co')
    again = Kept(tmp_path, "c0de")
    assert again.read({"seed": 0}) == {"x": 1}
    assert again.get({"seed": 1}) is None
    again.add({"seed": 1}, {"x": 2})
    assert Kept(tmp_path, "c0de").read({"seed": 1}) == {"x": 2}


def test_measures_survive_a_file():
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    values = {"a": np.eye(2), "b": (1, 2.5), "c": None, "d": ["x"], "e": image}
    values["f"] = {"g": np.float64(0.1), "h": [[1, 2], [3]], "i": np.nan}
    found = decode(json.loads(json.dumps(encode(values))))
    np.testing.assert_array_equal(found["a"], np.eye(2))
    np.testing.assert_array_equal(found["b"], [1.0, 2.5])
    assert (found["c"], found["d"], found["f"]["g"]) == (None, ["x"], 0.1)
    np.testing.assert_array_equal(found["e"], image)
    assert [list(row) for row in found["f"]["h"]] == [[1, 2], [3]]
    assert np.isnan(found["f"]["i"])


def test_quick_runs_one_case_of_each_kind(fake):
    ran = fake()
    run_experiment("fake_half", quick=True, workers=1)
    assert ran() == [2.0]


def test_parameters_override_those_of_the_name(fake):
    fake()
    overrides = ["lengths=[6, 9]"]
    (row,) = run_experiment("fake_third", overrides=overrides, workers=1).rows
    assert (row.name, row.quantity, row.measured) == ("third", "of 3", 3.0)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("cuont=3", "unknown key 'cuont' (did you mean 'count'? allowed: count, kind"),
        ("count", "--set count: must be KEY=VALUE"),
        ("count=many", "count: must be a number"),
        ("count=1.5", "count: must be a whole number"),
        ("count=0", "count: must be greater than 0, got 0"),
        ("count=[1", "--set count: not valid YAML"),
        ("lengths=2.0", "lengths: must be a list"),
        ("lengths=[]", "lengths: needs at least one entry"),
        ("lengths=[1.0, -2]", "lengths: must be greater than 0, got -2"),
        ("kind=tenth", "kind: must be one of half, third; got 'tenth'"),
    ],
)
def test_a_bad_parameter_is_an_error(fake, setting, message):
    ran = fake()
    with pytest.raises(ScenarioError) as error:
        run_experiment("fake_half", overrides=[setting], workers=1)
    assert message in str(error.value)
    assert ran() == []


@pytest.mark.slow
def test_workers_give_the_same_rows_as_one_process(tmp_path):
    results = [
        run_experiment("servo_laws", tmp_path / str(n), quick=True, workers=n).rows
        for n in (1, 2)
    ]
    assert results[0] == results[1]
    assert len((tmp_path / "2/trials.jsonl").read_text().split()) > 9
