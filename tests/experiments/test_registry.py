import contextlib
import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from common.test_status_line import Clock, Terminal

from drake_srg.common.status_line import StatusLine
from drake_srg.experiments import registry
from drake_srg.simulation import kept_replay
from experiments.fake_experiment import TWO


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


def test_a_line_shows_the_progress_of_an_experiment(monkeypatch):
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    line = functools.partial(StatusLine, clock=Clock(1.0))
    monkeypatch.setattr(registry, "StatusLine", line)
    track = registry.progress_line("fake_one")
    assert list(track([1, 2], label="case {}".format)) == [1, 2]
    shown = stream.getvalue()
    assert "fake_one: case 2" in shown
    assert "2/2" in shown


def test_the_replay_of_a_cell_is_kept_beside_the_results(fake, tmp_path, monkeypatch):
    fake(2.0)

    @contextlib.contextmanager
    def with_a_run(folder):
        if folder is not None:
            (folder / "replay.html").write_text("page")
            (folder / "log.npz").write_text("log")
        yield

    monkeypatch.setattr(kept_replay, "keep_first_replay", with_a_run)
    out = tmp_path / "out"
    registry.run_experiment("fake_one", out)
    assert (out / "replay.html").read_text() == "page"
    assert not list(out.rglob("log.npz"))
    assert not [path for path in out.iterdir() if path.is_dir()]
