import ctypes
import errno
import importlib.metadata
import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drake_srg.__main__ import main as drake_srg_command
from drake_srg.cli import main as main_module
from drake_srg.cli.main import main
from drake_srg.recording.output import read_log

# A run that ends after less than a second of simulated time.
ABSENT = ["run", "kitchen", "--set", "object.present=false", "--no-record"]
COMMANDS = ("run", "serve", "sweep", "report", "dataset", "list", "diagram", "bench")
COMMANDS += ("experiment", "doctor", "import", "replay", "demo")
COMMANDS += ("export", "new", "identify")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "kitchn"], ["kitchn", "kitchen"]),
        (["run", "missing.yaml"], ["missing.yaml", "cannot be read"]),
        (["run", "."], ["'.'", "unknown"]),
        (["run", "kitchen", "--set", "object.mas=1"], ["'mas'", "'mass'"]),
        (
            ["run", "kitchen", "--set", "gripper=!SrgPositionDrive {}"],
            ["gripper", "!SrgPositionDrive", "!SrgPositionDriver"],
        ),
        (["run", "kitchen", "--set", "object.mass"], ["KEY=VALUE"]),
        (["run", "kitchen", "--set", "arm=null"], ["arm"]),
        (["run", "kitchen", "--set", "directives=[]"], ["kitchen", "arm"]),
        (["bench", "kitchen", "--set", "arm.home=[0]"], ["kitchen: arm.home"]),
        (["diagram", "kitchen", "-o", "kitchen.jpg"], [".svg", ".dot"]),
        (["replay", "nowhere"], ["nowhere/replay.glb", "No such file"]),
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
        (["walk"], "walk"),
        (["run"], "SCENARIO"),
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


def test_a_scenario_that_nobody_may_read_is_one_line(tmp_path, capsys, monkeypatch):
    path = tmp_path / "mine.yaml"
    path.write_text("base: kitchen")
    read_text = Path.read_text

    def forbidden(self, **options):
        if self == path:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
        return read_text(self, **options)

    monkeypatch.setattr(Path, "read_text", forbidden)
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{path}: cannot be read: Permission denied" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_an_unwritable_folder_is_bad_input(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main([*ABSENT, "--out", str(tmp_path / "file" / "out")]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert "file/out" in error


@pytest.mark.slow
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


def test_a_demo_without_a_library_names_the_line_that_installs_it(
    tmp_path, capsys, monkeypatch
):
    def load(name):
        if name == "libEGL.so.1":
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", load)
    assert main(["demo", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "libEGL.so.1" in line
    assert "apt-get install -y --no-install-recommends" in line
    assert not (tmp_path / "out").exists()


def test_list_names_and_describes_the_scenarios(capsys):
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line.split(maxsplit=1)) == 2 for line in lines)
    assert all(line.endswith(".") for line in lines)  # no sentence is cut
    (described,) = [line for line in lines if line.startswith("kitchen ")]
    assert "can" in described


@pytest.mark.slow
def test_diagram_writes_graphviz(tmp_path, capsys):
    path = tmp_path / "cell.dot"
    assert main(["diagram", "kitchen_fast", "-o", str(path)]) == 0
    text = path.read_text()
    assert text.startswith("digraph")
    for system in ("planner", "localizer", "gripper_driver", "underactuation_logic"):
        assert system in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "word"),
    [
        ("arm=null", "kitchen: a cell also needs arm"),
        (
            "object.color_range={lower: [0, 0, 0], upper: [1, 1, -1]}",
            "soup_can.color_range",
        ),
    ],
)
def test_bad_settings_of_a_diagram_are_one_line(override, word, tmp_path, capsys):
    path = tmp_path / "kitchen.dot"
    assert main(["diagram", "kitchen", "-o", str(path), "--set", override]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line
    assert not path.exists()


@pytest.mark.slow
def test_drawing_without_graphviz_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert main(["diagram", "kitchen", "-o", str(tmp_path / "kitchen.svg")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "apt-get install -y graphviz" in line


@pytest.mark.slow
def test_a_diagram_that_graphviz_cannot_draw_is_one_line(tmp_path, capsys, monkeypatch):
    def fail(command, **_):
        raise subprocess.CalledProcessError(1, command, stderr="Error:\n  no fonts\n")

    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/dot")
    monkeypatch.setattr(subprocess, "run", fail)
    path = tmp_path / "kitchen.svg"
    assert main(["diagram", "kitchen", "-o", str(path)]) == 2
    said = capsys.readouterr().err
    assert said == f"drake-srg: -o {path}: cannot be drawn: Error: no fonts\n"


@pytest.mark.slow
def test_a_diagram_that_cannot_be_written_is_one_line(tmp_path, capsys):
    path = tmp_path / "missing" / "kitchen.dot"
    assert main(["diagram", "kitchen", "-o", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"-o {path}: cannot be written: No such file or directory" in line


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--help"])
    assert stopped.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    named = {word for line in lines for word in line[7:18].split()}
    assert set(COMMANDS) <= named
    groups = [line[:7].strip() for line in lines[4:-6] if line[:7].strip()]
    assert groups == ["run", "see", "vary", "learn", "robots", "make"]
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 34  # one screen
    assert main([]) == 0
    assert capsys.readouterr().out.splitlines() == lines


@pytest.mark.parametrize(
    ("arguments", "guess"),
    [
        (["runn"], "'run'"),
        (["run", "kitchen", "--sed", "3"], "'--seed'"),
        (["sweep", "kitchen", "--trials", "1", "--record", "al"], "'all'"),
        (["bench", "kitchn"], "'kitchen'"),
        (["experiment", "grip_lader"], "'grip_ladder'"),
    ],
)
def test_misspelt_words_are_guessed(arguments, guess, capsys):
    try:
        code = main(arguments)
    except SystemExit as stopped:
        code = stopped.code
    assert code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"did you mean {guess}?" in line


@pytest.mark.parametrize(
    "words", [["-q", "list"], ["list", "-q"], ["-q", "list", "-q"]]
)
def test_options_of_all_commands_stand_before_or_after_one(words, capsys):
    assert main(words) == 0
    assert capsys.readouterr().out == ""
    assert main([*words, "--json"]) == main(["--json", *words]) == 0
    first, second = capsys.readouterr().out.split("\n{")
    assert first.strip("{") == second.rstrip()


def test_every_help_is_a_sentence():
    parsers = main_module._parsers(main_module.make_parser())
    for name, parser in parsers.items():
        for action in parser._actions:
            assert action.help[0].isupper() or action.help[0] == "-", (name, action)
            assert action.help.endswith("."), (name, action.help)
            metavar = action.metavar or ""
            assert metavar == metavar.upper(), (name, metavar)
            assert action.choices is None or action.metavar, (name, action.help)


def test_folders_are_spelled_alike():
    for name, parser in main_module._parsers(main_module.make_parser()).items():
        spelled = [action.option_strings for action in parser._actions]
        for names in spelled:
            assert ("-o" in names) == ("--out" in names), name
            assert "--output" not in names, name


def test_a_scenario_comes_from_standard_input(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", io.StringIO("base: gripper_bench\n"))
    assert main(["export", "-", "--urdf"]) == 0
    assert (tmp_path / "out/export/stdin/gripper.urdf").is_file()
    monkeypatch.setattr(sys, "stdin", io.StringIO("objects: 3\n"))
    assert main(["run", "-"]) == 2
    assert "objects" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["list"], ["list", "--json"], ["--help"], ["--version"], ["walk"]]
)
def test_a_full_disk_is_one_line_and_a_code_of_its_own(arguments):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "drake_srg", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    (line,) = done.stderr.splitlines()
    if arguments == ["walk"]:
        assert done.returncode == 2
    else:
        assert done.returncode == 74
        assert line == "drake-srg: standard output: cannot be written: " + os.strerror(
            28
        )


@pytest.mark.parametrize("closed", ["1", "2"])
def test_a_closed_stream_is_no_error(closed):
    command = f"exec {sys.executable} -m drake_srg list {closed}>&-"
    done = subprocess.run(
        ["sh", "-c", command], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_describes_itself(command, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([command, "--help"])
    assert stopped.value.code == 0
    usage, description, *_ = capsys.readouterr().out.split("\n\n")
    assert usage.startswith(f"usage: drake-srg {command}")
    assert description[0].isupper() and description.endswith(".")


def test_the_version_is_printed(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--version"])
    assert stopped.value.code == 0
    version = importlib.metadata.version("drake_srg")
    assert capsys.readouterr().out == f"drake-srg {version}\n"


@pytest.mark.slow
def test_the_module_is_the_command(capsys):
    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "drake_srg", *arguments],
            capture_output=True,
            text=True,
            check=False,
        )

    assert main(["list"]) == 0
    listed = run("list")
    assert (listed.returncode, listed.stderr) == (0, "")
    assert listed.stdout == capsys.readouterr().out
    wrong = run("run", "kitchn")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.startswith("drake-srg: unknown scenario 'kitchn'")
    assert wrong.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_seen_enough_is_no_error(unbuffered):
    ends = os.pipe()
    os.close(ends[0])
    with os.fdopen(ends[1], "w") as output:
        listing = subprocess.run(
            [sys.executable, "-m", "drake_srg", "list"],
            stdout=output,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
            check=False,
        )
    assert (listing.returncode, listing.stderr) == (0, b"")


def test_ctrl_c_during_imports_is_one_line(monkeypatch, capsys):
    class Interrupted:
        def find_spec(self, name, path=None, target=None):
            if name == "drake_srg.cli.main":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "drake_srg.cli.main")
    monkeypatch.setattr(sys, "meta_path", [Interrupted(), *sys.meta_path])
    assert drake_srg_command() == 130
    assert capsys.readouterr().err == "drake-srg: stopped\n"
