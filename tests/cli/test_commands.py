import json
from pathlib import Path

import pytest
from replay.tiny_scene import record

from drake_srg.cli import commands
from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.simulation import benchmark, peers
from drake_srg.simulation.benchmark import Benchmark
from drake_srg.simulation.peers import Peer


def test_replay_makes_the_page_again_and_opens_it(tmp_path, capsys, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    record(tmp_path)
    assert main(["replay", str(tmp_path)]) == 0
    page = tmp_path / "replay.html"
    assert capsys.readouterr().out == f"{page}\n"
    first = page.read_bytes()
    assert opened == []
    assert main(["replay", str(tmp_path), "--open"]) == 0
    assert opened == [page.as_uri()]
    assert page.read_bytes() == first


def test_replay_of_two_runs_makes_a_page_of_both(tmp_path, capsys):
    for name in "ab":
        (tmp_path / name).mkdir()
        record(tmp_path / name, title=f"run {name}")
    folders = [str(tmp_path / name) for name in "ab"]
    page = tmp_path / "both.html"
    assert main(["replay", *folders, "-o", str(page)]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert page.read_text().count("<iframe") == 2
    assert main(["replay", *folders]) == 0
    assert (tmp_path / "a/compare.html").read_bytes() == page.read_bytes()
    assert main(["replay", folders[0], "-o", str(page)]) == 2
    assert "-o: needs several folders" in capsys.readouterr().err


@pytest.mark.parametrize("code", [0, 1])
def test_demo_is_a_recorded_run_of_the_kitchen(code, tmp_path, capsys, monkeypatch):
    ran, opened = [], []
    monkeypatch.setattr(commands, "run", lambda options: ran.append(options) or code)
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    assert main(["demo", "--out", str(tmp_path), "--open"]) == code
    (options,) = ran
    assert (options.scenario, options.out) == ("kitchen", tmp_path)
    assert opened == [(tmp_path / "replay.html").as_uri()]


def test_without_a_browser_the_page_is_there_nevertheless(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    record(tmp_path)
    assert main(["replay", str(tmp_path), "--open"]) == 2
    assert "--open: no browser found" in capsys.readouterr().err
    assert (tmp_path / "replay.html").is_file()


def test_bench_tells_scenarios_imports_and_peers(capsys, monkeypatch):
    measured = Benchmark("success", [0.001, 0.0, 0.0], 8.0, 0.6, 0.3, 0.1, 0.05, 0.4)
    peer = Peer("1.5.2", True, 8.25, 0.8, 260.0)
    monkeypatch.setattr(benchmark, "run_benchmark", lambda scenario, name: measured)
    monkeypatch.setattr(benchmark, "import_times", lambda: {"import drake_srg": 0.02})
    monkeypatch.setattr(peers, "measure_robosuite", {Path("other"): peer}.__getitem__)
    assert main(["bench", "kitchen_fast", "--peers", "other"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[-1] == "kitchen_fast : PickPlaceCan  0.75 of the wall clock"
    assert "import drake_srg              0.02 s" in said
    assert main(["bench", "kitchen_fast", "--peers", "other", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["scenarios"]["kitchen_fast"]["total"] == 0.6
    assert answer["imports"] == {"import drake_srg": 0.02}
    assert answer["robosuite"]["lift_steps_per_s"] == 260.0
    assert main(["bench", "kitchen_fast", "--json"]) == 0
    assert "robosuite" not in json.loads(capsys.readouterr().out)


def test_bench_prints_the_others_where_a_scenario_cannot_be_measured(
    capsys, monkeypatch
):
    measured = Benchmark("success", None, 8.0, 0.6, 0.3, 0.1, 0.05, 0.4)

    def run_benchmark(scenario, name):
        if name != "kitchen":
            raise ScenarioError(f"{name}: no arm")
        return measured

    monkeypatch.setattr(benchmark, "run_benchmark", run_benchmark)
    monkeypatch.setattr(benchmark, "import_times", lambda: {"import drake_srg": 0.02})
    names = ["kitchen_fast", "kitchen", "gripper_bench"]
    complaint = "kitchen_fast: no arm; gripper_bench: no arm"
    assert main(["bench", *names, "--quiet"]) == 2
    assert capsys.readouterr() == ("", f"drake-srg: {complaint}\n")
    assert main(["bench", *names]) == 2
    said = capsys.readouterr()
    assert said.out.split()[0] == "kitchen"
    assert "import drake_srg              0.02 s" in said.out
    assert said.err.splitlines()[-1] == f"drake-srg: {complaint}"
    assert main(["bench", *names, "--json", "--quiet"]) == 2
    answer = json.loads(capsys.readouterr().out)
    assert list(answer["scenarios"]) == ["kitchen"]
    assert answer["error"] == complaint
    assert main(["bench", "gripper_bench", "--quiet"]) == 2
    assert capsys.readouterr() == ("", "drake-srg: gripper_bench: no arm\n")
