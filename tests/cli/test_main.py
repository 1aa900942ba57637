import json
import shutil

import pytest

from drake_srg.cli.main import main
from drake_srg.recording.log import read_log

# A run that ends within a second of simulated time.
ABSENT = ["run", "kitchen", "--set", "object.present=false", "--no-record"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "kitchn"], ["kitchn", "kitchen"]),
        (["run", "missing.yaml"], ["missing.yaml", "cannot be read"]),
        (["run", "."], ["'.'", "unknown"]),
        (["run", "kitchen", "--set", "object.mas=1"], ["'mas'", "'mass'"]),
        (["run", "kitchen", "--set", "object.mass=heavy"], ["mass", "a number"]),
        (["run", "kitchen", "--set", "object.mass=-1"], ["mass", "greater than 0"]),
        (["run", "kitchen", "--set", "object.friction=-1"], ["friction", "at least 0"]),
        (["run", "kitchen", "--set", "object.friction=.nan"], ["friction", "NaN"]),
        (
            ["run", "kitchen", "--set", "object.mass=!Unifrom {min: 1, max: 2}"],
            ["mass", "!Unifrom"],
        ),
        (
            ["run", "kitchen", "--set", "gripper=!SrgPositionDrive {}"],
            ["gripper", "!SrgPositionDrive", "!SrgPositionDriver"],
        ),
        (["run", "kitchen", "--set", "object.mass"], ["KEY=VALUE"]),
        (["run", "kitchen", "--set", "object.position=[9, 9]"], ["not on the table"]),
        (["run", "kitchen", "--seed", "-1"], ["random_seed", "at least 0"]),
        (["run", "kitchen", "--set", "arm=null"], ["arm"]),
        (["run", "kitchen", "--set", "directives=[]"], ["kitchen", "arm"]),
        (
            ["run", "kitchen", "--set", "plant_config.contact_model=soft"],
            ["contact_model", "soft"],
        ),
        (
            ["run", "kitchen", "--set", "arm.kp=[-1,1,1,1,1,1,1]"],
            ["arm.kp", "at least"],
        ),
        (["bench", "kitchen", "--set", "arm.home=[0]"], ["kitchen: arm.home"]),
        (["diagram", "kitchen", "-o", "kitchen.jpg"], [".svg", ".dot"]),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(arguments, words, tmp_path, capsys):
    out = tmp_path / "out"
    if arguments[0] == "run":
        arguments = [*arguments, "--no-record", "--out", str(out)]
    assert main(arguments) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert len(output.err.splitlines()) == 1
    for word in words:
        assert word in output.err
    assert not list(tmp_path.rglob("*.*"))


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ([], "COMMAND"),
        (["walk"], "walk"),
        (["run"], "scenario"),
        (["run", "kitchen", "--seed", "x"], "--seed"),
        (["diagram", "kitchen"], "-o"),
    ],
)
def test_a_bad_command_line_is_one_line(arguments, word, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("drake-srg: ")
    assert word in line


def test_an_unwritable_folder_is_bad_input(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main([*ABSENT, "--out", str(tmp_path / "file" / "out")]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert "file/out" in error


def test_a_failed_task_exits_with_1_and_says_why(tmp_path, capsys):
    assert main([*ABSENT, "--out", str(tmp_path), "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    written = json.loads((tmp_path / "metrics.json").read_text())
    assert printed == written
    assert written["success"] is False
    assert written["failure"] == "not_seen"
    assert written["placement_error_m"] is None
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "log.npz",
        "metrics.json",
    ]
    assert set(read_log(tmp_path / "log.npz")) >= {"time", "mode"}


def test_list_names_and_describes_the_scenarios(capsys):
    assert main(["list"]) == 0
    assert "kitchen " in capsys.readouterr().out


def test_diagram_writes_graphviz(tmp_path, capsys):
    path = tmp_path / "kitchen.dot"
    assert main(["diagram", "kitchen", "-o", str(path)]) == 0
    text = path.read_text()
    assert text.startswith("digraph")
    for system in ("planner", "localizer", "gripper_driver"):
        assert system in text


@pytest.mark.parametrize(
    ("override", "word"),
    [
        ("arm.home=[0]", "kitchen: arm.home"),
        ("arm=null", "kitchen: a cell also needs arm"),
        (
            "object.color_range={lower: [0, 0, 0], upper: [1, 1, -1]}",
            "soup_can.color_range",
        ),
        ("plant_config.contact_model=soft", "contact_model"),
    ],
)
def test_bad_settings_of_a_diagram_are_one_line(override, word, tmp_path, capsys):
    path = tmp_path / "kitchen.dot"
    assert main(["diagram", "kitchen", "-o", str(path), "--set", override]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line
    assert not path.exists()


def test_drawing_without_graphviz_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert main(["diagram", "kitchen", "-o", str(tmp_path / "kitchen.svg")]) == 2
    assert "apt-get install -y graphviz" in capsys.readouterr().err


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--help"])
    assert stopped.value.code == 0
    text = capsys.readouterr().out
    for command in ("run", "list", "diagram", "bench", "experiment", "doctor"):
        assert command in text
