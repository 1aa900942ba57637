import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drake_srg import experiments
from drake_srg.cli.main import main
from drake_srg.experiments import registry

FAKE = '''"""Half of what was asked for.

More words.
"""
from collections.abc import Sequence
from typing import Literal

from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import make_figure

{declared}

def run(
    track,
    *,
    count: int = 2,
    lengths: Sequence[float] = (2.0, 4.0),
    kind: Literal["half", "third"] = "half",
):
    """Divide lengths.

    Args:
        track: Shows progress.
        count: How often,
            in whole numbers.
        lengths: To divide [m].
        kind: The part of a length to
            return.
    """
    parts = [length / (2 if kind == "half" else 3) for length in track(lengths)]
    if {stop}:
        raise KeyboardInterrupt
    rows = [Row.at_most(kind, f"of {{count}}", {limit}, parts[-1], "m")]
    tables = {{"parts": {{"part [m]": parts}}}}
    return ExperimentResult(rows, tables, make_figure(2, 2))
'''
TWO = """
EXPERIMENTS = {
    "fake_half": ("Half.", {}),
    "fake_third": ("A third.", {"kind": "third", "count": 3}),
}
"""


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Adds an experiment `fake_one` whose limit can be chosen."""
    folder = tmp_path / "more_experiments"
    folder.mkdir()
    (folder / "helper.py").write_text("def walk():\n    pass\n")
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(folder)])

    def write(limit, stop=False, declared=""):
        text = FAKE.format(limit=limit, stop=stop, declared=declared)
        (folder / "fake_one.py").write_text(text)
        monkeypatch.delitem(sys.modules, f"{experiments.__name__}.fake_one", False)

    yield write
    sys.modules.pop(f"{experiments.__name__}.fake_one", None)


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "code", "word"), [(2.0, 0, "ok"), (1.5, 1, "FAIL")])
def test_the_exit_code_says_whether_all_rows_pass(
    fake, limit, code, word, tmp_path, capsys
):
    fake(limit)
    out = tmp_path / "out"
    assert main(["experiment", "fake_one", "--out", str(out)]) == code
    printed = capsys.readouterr().out
    assert word in printed
    for name in ("result.json", "parts.csv", "fake_one.png"):
        assert str(out / name) in printed
        assert (out / name).is_file()
    (row,) = json.loads((out / "result.json").read_text())
    assert row["pass"] == (code == 0)
    assert row["measured"] == 2.0


def test_results_go_to_a_folder_named_after_the_experiment(fake, tmp_path, monkeypatch):
    fake(2.0)
    monkeypatch.chdir(tmp_path)
    assert main(["experiment", "fake_one"]) == 0
    assert (tmp_path / "out/experiments/fake_one/result.json").is_file()


def test_an_experiment_is_a_file_with_a_function_run(fake):
    fake(2.0)
    found = registry.list_experiments()
    assert found["fake_one"] == "Half of what was asked for."
    assert not {"helper", "result", "registry", "__init__"} & set(found)
    assert list(found) == sorted(found)


@pytest.mark.slow
def test_a_file_can_declare_several_experiments(fake):
    fake(2.0, declared=TWO)
    found = registry.list_experiments()
    assert "fake_one" not in found
    assert (found["fake_half"], found["fake_third"]) == ("Half.", "A third.")
    rows = [registry.run_experiment(f"fake_{n}").rows[0] for n in ("half", "third")]
    assert [(row.name, row.quantity) for row in rows] == [
        ("half", "of 2"),
        ("third", "of 3"),
    ]


@pytest.mark.slow
def test_parameters_of_the_command_line_override_those_of_the_name(fake, tmp_path):
    fake(4.0, declared=TWO)
    command = ["experiment", "fake_third", "--out", str(tmp_path)]
    command += ["--set", "count=5", "--set", "lengths=[6, 9]"]
    assert main(command) == 0
    (row,) = json.loads((tmp_path / "result.json").read_text())
    assert (row["name"], row["quantity"]) == ("third", "of 5")
    assert row["measured"] == 3.0


@pytest.mark.slow
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
def test_a_bad_parameter_is_one_line(fake, setting, message, tmp_path, capsys):
    fake(2.0)
    out = tmp_path / "out"
    command = ["experiment", "fake_one", "--out", str(out), "--set", setting]
    assert main(command) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert not out.exists()


def test_help_after_a_name_shows_its_parameters(fake, capsys):
    fake(2.0, declared=TWO)
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "fake_third", "--help"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out.splitlines() == [
        "fake_third: A third.",
        "",
        "parameters (--set KEY=VALUE):",
        "  count=3  How often, in whole numbers.",
        "  lengths=[2.0, 4.0]  To divide [m].",
        "  kind=third  The part of a length to return.",
    ]


def test_help_without_a_name_shows_the_options(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "--help"])
    assert stopped.value.code == 0
    printed = capsys.readouterr().out
    assert "NAME" in printed
    assert "--set KEY=VALUE" in printed


def test_help_on_an_unknown_experiment_is_bad_input(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", "payload_warp", "--help"])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "did you mean 'payload_wrap'?" in line


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", registry.list_experiments() | registry.list_measurements()
)
def test_every_experiment_is_described(name):
    experiment = registry.find_experiment(name)
    assert experiment.description.endswith(".")
    for parameter in experiment.parameters.values():
        assert parameter.description.endswith(".")
        assert parameter.default is not None
    assert set(experiment.preset) <= set(experiment.parameters)


@pytest.mark.slow
def test_an_unknown_name_is_answered_with_the_list(fake, tmp_path, capsys):
    fake(2.0)
    out = tmp_path / "out"
    assert main(["experiment", "fake_on", "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "did you mean 'fake_one'?" in line
    for name in (*registry.list_experiments(), *registry.list_measurements()):
        assert name in line
    assert not out.exists()


def test_the_tools_folder_holds_the_measurements_that_the_package_names():
    assert tuple(registry.list_measurements()) == registry.MEASUREMENTS


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.MEASUREMENTS)
def test_an_installed_package_says_that_measurements_need_a_checkout(installed, name):
    done = installed("experiment", name)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert f"experiment {name!r} is in tools/measure and needs a checkout" in line


def test_an_installed_package_lists_its_own_experiments_only(installed):
    done = installed("experiment", "--list")
    assert done.returncode == 0
    listed = [line.split()[0] for line in done.stdout.splitlines()]
    assert listed == list(registry.list_experiments())


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Run `drake-srg` of a package without a checkout around it."""
    folder = tmp_path_factory.mktemp("site-packages")
    package = Path(registry.__file__).parents[1]
    shutil.copytree(package, folder / "drake_srg")
    code = (
        "import sys; from drake_srg.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )

    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-c", code, *arguments],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(folder)},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def test_an_interrupted_experiment_leaves_nothing_behind(fake, tmp_path, capsys):
    fake(2.0, stop=True)
    out = tmp_path / "new" / "out"
    assert main(["experiment", "fake_one", "--out", str(out)]) == 2
    assert capsys.readouterr().err == "drake-srg: stopped\n"
    assert not out.parent.exists()


def test_an_unwritable_folder_is_bad_input(fake, tmp_path, capsys):
    fake(2.0)
    (tmp_path / "file").write_text("in the way")
    out = tmp_path / "file" / "out"
    assert main(["experiment", "fake_one", "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--out {out}: cannot be written" in line


@pytest.mark.parametrize("arguments", [[], ["fake_one", "--list"]])
def test_either_a_name_or_the_list_is_needed(arguments, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", *arguments])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--list" in line


@pytest.mark.parametrize("arguments", [["--list"], ["payload_wrap", "--help"]])
def test_list_and_help_appear_without_importing_drake(arguments):
    code = f"""
import sys
from drake_srg.cli.main import main
try:
    main(["experiment", *{arguments}])
except SystemExit:
    pass
sys.exit(any(m in sys.modules for m in ("pydrake", "matplotlib", "numpy")))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    own, _, for_maintainers = done.stdout.partition("\n\n")
    first = [line.split()[0] for line in own.splitlines()]
    if arguments == ["--list"]:
        assert first == list(registry.list_experiments())
        heading, *lines = for_maintainers.splitlines()
        assert heading == "For maintainers, in a checkout only (tools/measure):"
        assert tuple(line.split()[0] for line in lines) == registry.MEASUREMENTS
    else:
        assert first == ["payload_wrap:"]


def test_the_bar_shows_the_progress_of_an_experiment(capsys):
    track = registry.progress_bar("fake_one")
    assert list(track([1, 2], label="case {}".format)) == [1, 2]
    shown = capsys.readouterr().err
    assert "fake_one: case 2" in shown
    assert "2/2" in shown
