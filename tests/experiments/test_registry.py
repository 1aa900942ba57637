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
from drake_srg.experiments.result import ExperimentResult, Row
from drake_srg.recording.figure import make_figure

def run(track):
    halves = [0.5 * case for case in track([2.0, 4.0])]
    if {stop}:
        raise KeyboardInterrupt
    rows = [Row.at_most("half", "of 4", {limit}, halves[1], "m")]
    tables = {{"halves": {{"half [m]": halves}}}}
    return ExperimentResult(rows, tables, make_figure(2, 2))
'''


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Adds an experiment `fake_one` whose limit can be chosen."""
    folder = tmp_path / "more_experiments"
    folder.mkdir()
    (folder / "helper.py").write_text("def walk():\n    pass\n")
    monkeypatch.setattr(experiments, "__path__", [*experiments.__path__, str(folder)])

    def write(limit, stop=False):
        text = FAKE.format(limit=limit, stop=stop)
        (folder / "fake_one.py").write_text(text)
        monkeypatch.delitem(sys.modules, f"{experiments.__name__}.fake_one", False)

    yield write
    sys.modules.pop(f"{experiments.__name__}.fake_one", None)


@pytest.mark.parametrize(("limit", "code", "word"), [(2.0, 0, "ok"), (1.5, 1, "FAIL")])
def test_the_exit_code_tells_whether_all_rows_pass(
    fake, limit, code, word, tmp_path, capsys
):
    fake(limit)
    out = tmp_path / "out"
    assert main(["experiment", "fake_one", "--out", str(out)]) == code
    printed = capsys.readouterr().out
    assert word in printed
    for name in ("result.json", "halves.csv", "fake_one.png"):
        assert str(out / name) in printed
        assert (out / name).is_file()
    (row,) = json.loads((out / "result.json").read_text())
    assert row["pass"] == (code == 0)
    assert row["measured"] == 2.0


def test_by_default_results_go_to_a_folder_of_their_own(fake, tmp_path, monkeypatch):
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


def test_every_experiment_is_described_in_one_line():
    listed = registry.list_experiments() | registry.list_measurements()
    for name, description in listed.items():
        assert description.endswith("."), name


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


def test_what_is_interrupted_leaves_nothing(fake, tmp_path, capsys):
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
def test_a_name_or_the_list_is_needed(arguments, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["experiment", *arguments])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--list" in line


def test_the_list_comes_without_drake():
    code = (
        "import sys; from drake_srg.cli.main import main; "
        "main(['experiment', '--list']);"
        "sys.exit(any(m in sys.modules for m in ('pydrake', 'matplotlib', 'numpy')))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    own, for_maintainers = done.stdout.split("\n\n")
    listed = [line.split()[0] for line in own.splitlines()]
    assert listed == list(registry.list_experiments())
    heading, *lines = for_maintainers.splitlines()
    assert heading == "For maintainers, in a checkout only (tools/measure):"
    assert tuple(line.split()[0] for line in lines) == registry.MEASUREMENTS


def test_the_bar_shows_where_an_experiment_is(capsys):
    track = registry.progress_bar("fake_one")
    assert list(track([1, 2], label="case {}".format)) == [1, 2]
    shown = capsys.readouterr().err
    assert "fake_one: case 2" in shown
    assert "2/2" in shown
