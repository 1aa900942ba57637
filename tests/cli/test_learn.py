import json

import pytest
from learning.made_policies import made_policy
from sweeps.stub import StubEngine

from drake_srg.cli.learn import keywords
from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError

HIT = "tests.learning.toy:toy/Hit-v0"


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr("drake_srg.cli.learn.make_engine", lambda _: StubEngine())


@pytest.mark.learn
def test_train_writes_a_policy_that_says_how_it_was_made(tmp_path, capsys):
    out = tmp_path / "out"
    words = ["train", HIT, "--steps", "110", "--validation", "5", "--set", "size=1"]
    assert main([*words, "--out", str(out), "--json", "-q"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["policy"] == str(out / "policy.npz")
    log = json.loads((out / "training.json").read_text())["training"]
    assert log["command"].startswith(f"drake-srg train {HIT} --algo q --steps 110")
    assert log["keywords"] == {"size": 1}


def test_evaluate_prints_a_table_with_the_baselines(tmp_path, capsys):
    made_policy(environment=HIT).save(tmp_path / "policy.npz")
    out = tmp_path / "out"
    words = ["evaluate", str(tmp_path / "policy.npz"), HIT, "--trials", "3"]
    assert main([*words, "--out", str(out), "--report"]) == 0
    text = capsys.readouterr().out
    assert "rule 3 of 3 100.0% 43.9% to 100.0%" in " ".join(text.split())
    page = (out / "policy" / "report.html").read_text()
    assert f"drake-srg evaluate {tmp_path}" in page
    assert {path.name for path in out.iterdir()} == {"policy", "rule", "random"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["train", "Nothing"], "unknown environment 'drake_srg/Nothing-v0'"),
        (["train", HIT, "--set", "x"], "--set x: must be KEY=VALUE"),
        (["train", HIT, "--set", "a=2020-01-01"], "must be KEY=VALUE"),
        (["train", HIT, "--set", "#=1"], "must be KEY=VALUE"),
        (["train", ".toy:Hit"], "ENV: .toy:Hit-v0"),
        (["train", HIT, "--validation", "0"], "--validation 0"),
        (["evaluate", "none.npz", HIT, "--trials", "1"], "No such file"),
        (["evaluate", "rule", HIT, "--trials", "0"], "--trials 0"),
        (["evaluate", "rule", HIT, "--trials", "1", "--seed", "1"], "--seed 1"),
        (
            ["evaluate", "grasp_one_shot", "kitchen_fast", "--trials", "1"],
            "was trained with driver=plant",
        ),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("algorithm", ["q", "sac", "bc", "dagger"])
def test_train_without_its_packages_says_what_to_install(
    tmp_path, monkeypatch, capsys, algorithm
):
    monkeypatch.setitem(__import__("sys").modules, "torch", None)
    words = ["train", HIT, "--algo", algorithm, "--out", str(tmp_path)]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "pip install 'drake_srg[learn]'" in error
    assert "CPU build" in error
    assert error.count("\n") == 1


def test_keywords_are_yaml():
    found = keywords(["noise=0.015", "driver=tendon", "touch=false"])
    assert found == {"noise": 0.015, "driver": "tendon", "touch": False}
    with pytest.raises(ScenarioError):
        keywords(["a={"])
