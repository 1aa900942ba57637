"""`drake-srg run --hardware` reports the planner's own verdict: there is no other."""

import dataclasses as dc
import json
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from recording.replay.tiny_scene import record
from simulation.made_logs import BLOB, judge, make_log

import drake_srg.robot.drive.run
import drake_srg.simulation
from drake_srg.cli import commands
from drake_srg.cli.main import main, make_parser
from drake_srg.common.exceptions import ScenarioError
from drake_srg.simulation import benchmark
from drake_srg.simulation.benchmark import Benchmark, Peer
from drake_srg.simulation.simulate import STOPPED_BY_USER, Result
from drake_srg.types import Mode, PlannerStatus


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

    def run(options):
        ran.append(options)
        return code

    monkeypatch.setattr(commands, "run", run)
    monkeypatch.setattr(sys, "argv", [".venv/bin/drake-srg"])
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    assert main(["demo", "--out", str(tmp_path), "--open"]) == code
    (options,) = ran
    assert (options.scenario, options.out) == ("kitchen", tmp_path)
    first, *others = capsys.readouterr().out.splitlines()[-3:]
    assert f"Open {tmp_path / 'replay.html'}" in first
    for line in others:  # what it says to try is understood
        assert ": .venv/bin/drake-srg " in " ".join(line.split())
        words = shlex.split(line.partition("drake-srg")[2])
        assert make_parser().parse_args(words).command == words[0]
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
    monkeypatch.setattr(
        benchmark, "measure_robosuite", {Path("other"): peer}.__getitem__
    )
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


PARTS = "arm: !Ros2Arm {}\ngripper: !Ros2Gripper {}\n"


def without_truth():
    """Return the log of a robot's run, which does not tell where objects are."""
    log = make_log()
    del log["object_pose.soup_can"], log["contact_force"]
    return log


@pytest.mark.parametrize(("claimed", "code"), [(True, 0), (False, 1)])
def test_the_exit_code_follows_what_is_claimed(
    claimed, code, tmp_path, capsys, monkeypatch
):
    mode = Mode.DONE if claimed else Mode.FAILED
    status = PlannerStatus(mode=mode, attempts=1, localization=BLOB, localized_at=0.0)

    def run(scenario, config, *, out, **_):
        metrics = dc.replace(
            judge(without_truth(), status), success=False, claimed=claimed
        )
        metrics.write(out / "metrics.json")
        return Result(metrics, {}, status)

    monkeypatch.setattr(drake_srg.robot.drive.run, "run_on_hardware", run)
    (tmp_path / "robot.yaml").write_text(PARTS)
    out = tmp_path / "out"
    command = ["run", "kitchen", "--hardware", str(tmp_path / "robot.yaml")]
    assert main([*command, "--out", str(out)]) == code
    assert ("done, by the planner's word" in capsys.readouterr().out) == claimed
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["success"] is None
    assert metrics["claimed"] is claimed
    assert metrics["placement_error_m"] is metrics["localization_error_m"] is None


BENCH = ["export", "gripper_bench"]


def test_export_prints_its_files_and_the_error_of_the_wires(tmp_path, capsys):
    assert main([*BENCH, "--mjcf", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    for name in ("arm", "gripper", "scene"):
        path = tmp_path / "out" / f"{name}.xml"
        assert path.is_file()
        assert str(path) in printed
    assert "Moment arms of the tendons: within 0.25% of the wires'." in printed


def test_json_names_every_model(tmp_path, capsys):
    assert main([*BENCH, "--urdf", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["moment_arm_error"] is None
    assert answer["models"]["gripper"] == str(tmp_path / "gripper.urdf")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["export", "nowhere", "--sdf", "out"], "'nowhere'"),
        ([*BENCH, "--sdf", "file/out"], "--out file/out: cannot be written"),
        (
            [*BENCH, "--set", "object={soft: {edge: 0.02}}", "--sdf", "out"],
            "soft",
        ),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, arguments, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_in_the_way_of_a_file_stops_all_files(tmp_path, capsys):
    (tmp_path / "gripper.urdf").mkdir()
    assert main([*BENCH, "--urdf", str(tmp_path), "--replace"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--out {tmp_path}: cannot be written: Is a directory" in line
    assert [path.name for path in tmp_path.iterdir()] == ["gripper.urdf"]
    assert not list((tmp_path / "gripper.urdf").iterdir())


@pytest.mark.parametrize("formats", [[], ["--urdf", "a", "--sdf", "b"]])
def test_exactly_one_format_is_asked_for(formats, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([*BENCH, *formats])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--urdf" in line


ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("projects")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["new", "my_cell", "--quiet"]) == 0
    return folder / "my_cell"


def test_a_project_has_its_files_with_its_name(project):
    assert sorted(path.name for path in project.iterdir()) == [
        ".gitignore",
        "README.md",
        "cell.py",
        "my_cell.yaml",
        "notebook.ipynb",
        "pyproject.toml",
        "test_cell.py",
    ]
    about = tomllib.loads((project / "pyproject.toml").read_text())
    assert about["project"]["name"] == "my_cell"
    for path in project.iterdir():
        assert "@NAME@" not in path.read_text()
    assert "# my_cell" in (project / "README.md").read_text()


@pytest.mark.slow
def test_a_project_passes_its_tests_and_its_notebook_runs(project):
    notebook = json.loads((project / "notebook.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    script = "\n".join("".join(cell["source"]) for cell in cells)
    (project / "test_notebook.py").write_text(
        "def test_notebook():\n"
        '    import matplotlib; matplotlib.use("Agg")\n'
        f"    exec({script!r}, {{}})\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=project,
        env={
            "PYTHONPATH": str(ROOT),
            "PATH": "/usr/bin:/bin",
            "OPENBLAS_NUM_THREADS": "1",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert "3 passed" in done.stdout, done.stdout[-2000:]


def test_a_project_is_formatted(project):
    ruff = Path(sys.executable).with_name("ruff")
    for command in (["check", "--select", "E,F,I,UP,B"], ["format", "--check"]):
        files = [project / "cell.py", project / "test_cell.py"]
        config = ["--config", "line-length = 88", "--isolated"]
        subprocess.run([ruff, *command, *config, *files], check=True)


BAD_NAMES = {
    name: f"NAME {name!r}: invalid (allowed: "
    for name in ("", "My", "a-b", "../x", "class", "1st", "a b")
} | {
    name: f"NAME {name}: a Python module has this name"
    for name in ("drake_srg", "numpy", "json", "cell")
}


@pytest.mark.parametrize(("name", "words"), BAD_NAMES.items())
def test_a_bad_name_is_refused(name, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", name]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_cell_of_a_project_runs_and_sweeps(project, monkeypatch, capsys):
    monkeypatch.chdir(project)
    own = ["my_cell.yaml", "--cell", "cell:make_cell"]
    soon = ["--set", "planner.time_budget=0.5"]
    assert main(["run", *own, *soon, "--no-record"]) == 1
    metrics = json.loads((project / "out/my_cell/metrics.json").read_text())
    assert metrics["scenario"] == "my_cell"
    assert main(["sweep", *own, *soon, "--trials", "1", "--jobs", "1"]) == 0
    assert "0 of 1" in capsys.readouterr().out
    info = json.loads((project / "out/sweeps/my_cell/sweep.json").read_text())
    assert info["cell"] == "cell:make_cell"


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("cell", "must be MODULE:FUNCTION"),
        ("nothing_here:make", "cannot be imported: ModuleNotFoundError"),
        ("json:make", "json has no function 'make'"),
    ],
)
def test_a_cell_that_is_none_is_told(cell, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "assistive_arm", "--cell", cell]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--cell {cell}: " in line
    assert words in line
    assert not list(tmp_path.iterdir())


def test_an_existing_folder_stays_as_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    assert main(["new", "mine"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "already exists" in line
    assert not list((tmp_path / "mine").iterdir())


def test_a_folder_that_is_gone_is_told(tmp_path, monkeypatch, capsys):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert main(["new", "my_cell"]) == 2
    assert "NAME my_cell: cannot be written: No such file" in capsys.readouterr().err


def test_models_of_another_export_stay_unless_they_are_to_be_replaced(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    own = Path("mine/gripper.urdf")
    own.write_text("mine")
    assert main([*BENCH, "--urdf", "-o", "mine"]) == 2
    assert "--out mine: already has results (gripper.urdf)" in capsys.readouterr().err
    assert own.read_text() == "mine"
    other = Path("mine/other.urdf")
    other.touch()
    assert main([*BENCH, "--urdf", "-o", "mine", "--replace"]) == 0
    assert own.read_text() != "mine"
    assert other.exists()
    for folder in ("out/export/gripper_bench", "out/export/gripper_bench-2"):
        assert main([*BENCH, "--sdf"]) == 0
        assert Path(folder, "scene.sdf").is_file()


@pytest.mark.parametrize("name", ["run", "demo"])
def test_a_second_run_leaves_the_first_as_it_is(name, tmp_path, monkeypatch, capsys):
    def simulate(scenario, *, out, **_):
        metrics = judge(make_log())
        metrics.write(out / "metrics.json")
        (out / "video.mp4").write_text(f"made in {out}")
        return Result(metrics, {}, PlannerStatus(mode=Mode.DONE))

    monkeypatch.setattr(drake_srg.simulation, "Simulate", simulate)
    monkeypatch.chdir(tmp_path)
    command = ["run", "kitchen"] if name == "run" else ["demo"]
    for folder in ("out/kitchen", "out/kitchen-2", "mine"):
        more = ["-o", "mine"] if folder == "mine" else []
        assert main([*command, *more]) == 0
        assert Path(folder, "video.mp4").read_text() == f"made in {folder}"
    assert main([*command, "-o", "mine"]) == 2
    assert "mine: already has results (metrics.json)" in capsys.readouterr().err
    assert main([*command, "-o", "mine", "--replace"]) == 0
    assert Path("out/kitchen/video.mp4").read_text() == "made in out/kitchen"


def test_a_run_that_was_interrupted_is_judged_and_ends_with_130(tmp_path, monkeypatch):
    def simulate(scenario, *, out, **_):
        metrics = judge(make_log())
        metrics.write(out / "metrics.json")
        return Result(metrics, {}, PlannerStatus(message=STOPPED_BY_USER))

    monkeypatch.setattr(drake_srg.simulation, "Simulate", simulate)
    assert main(["run", "kitchen", "-o", str(tmp_path), "-q"]) == 130
    assert (tmp_path / "metrics.json").is_file()
