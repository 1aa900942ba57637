import json
import subprocess
import sys
from pathlib import Path

import pytest

from drake_srg.cli.main import main

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
        "README.md",
        "cell.py",
        "notebook.ipynb",
        "scenario.yaml",
        "test_cell.py",
    ]
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


@pytest.mark.parametrize("name", ["", "My", "a-b", "../x", "class", "1st", "a b"])
def test_a_bad_name_is_refused(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", name]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"NAME {name!r}: invalid (allowed: " in line
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
