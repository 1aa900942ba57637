import shutil

import pytest

from drake_srg.parsing import models_path
from drake_srg.sweeps import sources
from drake_srg.sweeps.info import current_versions
from drake_srg.sweeps.sources import hash_files, sources_hash


def write(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


@pytest.fixture
def package(tmp_path):
    """A checkout: models beside the package."""
    write(tmp_path, {"package/a.py": "1", "package/b/c.yaml": "2"})
    write(tmp_path, {"models/sdf/can.sdf": "3", "models/meshes/can.obj": "4"})
    return tmp_path


def hash_of(folder):
    return hash_files(folder / "package", folder / "models")


@pytest.mark.parametrize(
    "name", ["package/a.py", "package/b/c.yaml", "models/meshes/can.obj"]
)
def test_it_tells_contents_and_names(package, name):
    before, path = hash_of(package), package / name
    text = path.read_text()
    path.write_text("other")
    assert hash_of(package) != before
    path.write_text(text)
    assert hash_of(package) == before
    path.rename(path.with_stem("other"))
    assert hash_of(package) != before


@pytest.mark.parametrize(
    "name",
    ["a.py~", ".a.py.swp", "__pycache__/a.pyc", "sweeps/report/page.py", "b/x.md"],
)
def test_what_no_trial_depends_on_does_not_count(package, name):
    before = hash_of(package)
    write(package / "package", {name: "x"})
    assert hash_of(package) == before


def test_a_wheel_has_that_of_its_checkout(package):
    before = hash_of(package)
    shutil.move(package / "models", package / "package/models")
    inside = package / "package"
    assert hash_files(inside, inside / "models") == before


def test_all_files_of_the_models_count():
    suffixes = {path.suffix for path in models_path().rglob("*") if path.is_file()}
    assert suffixes <= sources.SUFFIXES


def test_it_is_among_the_versions():
    assert len(sources_hash()) == 12
    assert current_versions()["drake_srg_sources"] == sources_hash()
