import dataclasses as dc
import shutil

import pytest
from test_storeys import MODULES, PACKAGE, dotted, imports

from drake_srg.face import names_of
from drake_srg.parsing import models_path
from drake_srg.sweeps.info import (
    NOT_IN_A_TRIAL,
    SUFFIXES,
    SweepInfo,
    current_versions,
    difference,
    dump_tree,
    hash_files,
    hash_model_files,
    read_sweep,
    sources_hash,
    version_difference,
)


def write(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


@pytest.fixture
def package(tmp_path):
    """A checkout: the models are beside the package."""
    write(tmp_path, {"package/a.py": "1", "package/b/c.yaml": "2"})
    write(tmp_path, {"models/sdf/can.sdf": "3", "models/meshes/can.obj": "4"})
    return tmp_path


def hash_of(folder):
    folders = {"": folder / "package", "models/": folder / "models"}
    return hash_files(folders, NOT_IN_A_TRIAL)


@pytest.mark.parametrize(
    "name", ["package/a.py", "package/b/c.yaml", "models/meshes/can.obj"]
)
def test_contents_and_names_change_the_hash(package, name):
    before, path = hash_of(package), package / name
    text = path.read_text()
    path.write_text("other")
    assert hash_of(package) != before
    path.write_text(text)
    assert hash_of(package) == before
    path.rename(path.with_stem("other"))
    assert hash_of(package) != before


@pytest.mark.parametrize("name", ["a.py~", ".a.py.swp", "__pycache__/a.pyc", "b/x.md"])
def test_leftovers_of_editors_and_texts_do_not_change_the_hash(package, name):
    before = hash_of(package)
    write(package / "package", {name: "x"})
    assert hash_of(package) == before


@pytest.mark.parametrize("name", NOT_IN_A_TRIAL)
def test_code_that_no_trial_imports_does_not_change_the_hash(package, name):
    before = hash_of(package)
    write(package / "package", {f"{name}page.py" if name[-1] == "/" else name: "x"})
    assert hash_of(package) == before


@pytest.mark.parametrize("name", NOT_IN_A_TRIAL)
def test_all_code_counts_unless_it_is_left_out(package, name):
    folders = {"": package / "package"}
    before = hash_files(folders)
    write(package / "package", {f"{name}page.py" if name[-1] == "/" else name: "x"})
    assert hash_files(folders) != before


def test_a_wheel_and_its_checkout_have_the_same_hash(package):
    before = hash_of(package)
    shutil.move(package / "models", package / "package/models")
    inside = package / "package"
    folders = {"": inside, "models/": inside / "models"}
    assert hash_files(folders, NOT_IN_A_TRIAL) == before


def imported_modules(start):
    """The modules, dotted below drake_srg, that a module imports, directly or not."""
    files = {dotted(path): path for path in MODULES}
    packages = [dotted(stub.with_suffix(".py")) for stub in PACKAGE.rglob("*.pyi")]
    # The modules that the names of packages' faces come from.
    faces = {name: names_of(f"drake_srg.{name}") for name in packages if name in files}
    found, waiting = set(), [start]
    while waiting:
        package, _, name = waiting[-1].rpartition(".")
        parts = waiting.pop().split(".")
        if name in faces.get(package, {}):
            waiting.append(faces[package][name].removeprefix("drake_srg."))
        for end in range(1, len(parts) + 1):  # importing a.b.c imports a and a.b, too
            module = ".".join(parts[:end])
            if module in files and module not in found:
                found.add(module)
                waiting += imports(files[module].read_text("utf-8"), module)
    return {files[name].relative_to(PACKAGE).as_posix() for name in found}


@pytest.mark.slow
def test_everything_that_a_trial_imports_is_hashed():
    imported = imported_modules("sweeps.trial")
    assert {"sweeps/trial.py", "simulation/simulate.py", "types.py"} <= imported
    assert [name for name in imported if name.startswith(NOT_IN_A_TRIAL)] == []


def test_every_exception_names_something_in_the_package():
    assert [name for name in NOT_IN_A_TRIAL if not (PACKAGE / name).exists()] == []


def test_every_kind_of_model_file_is_hashed():
    suffixes = {path.suffix for path in models_path().rglob("*") if path.is_file()}
    assert suffixes <= SUFFIXES


def test_the_hash_is_among_the_versions():
    assert len(sources_hash()) == 12
    assert current_versions()["drake_srg_sources"] == sources_hash()


TREE = {"object": {"mass": 0.3, "position": [0.1, 0.2]}, "seed": None}
INFO = SweepInfo(
    "kitchen", 7, 10, "none", ["a=1"], dump_tree(TREE), {"drake": "1"}, jobs=2
)


def changed(**changes):
    return dc.replace(INFO, **changes)


def test_a_sweep_is_read_as_it_was_written(tmp_path):
    INFO.write(tmp_path)
    assert read_sweep(tmp_path) == INFO


@pytest.mark.parametrize(
    ("new", "expected"),
    [
        (INFO, ""),
        (changed(trials=11, engine="ray", jobs=None, started="now"), ""),
        (changed(trials=9), "trials: was 10, is 9"),
        (changed(seed=8), "seed: was 7, is 8"),
        (changed(record="all"), "record: was none, is all"),
        (changed(versions={"drake": "2"}), "drake: was 1, is 2"),
        (
            changed(tree=dump_tree(TREE | {"object": {"mass": 0.4}})),
            "object.mass: was 0.3, is 0.4",
        ),
        (
            changed(tree=dump_tree(TREE | {"object": {"mass": 0.3, "position": []}})),
            "object.position.0: was 0.1, is missing",
        ),
    ],
)
def test_the_first_difference_is_named(new, expected):
    assert difference(INFO, new) == expected


@pytest.mark.parametrize(
    ("name", "decisive"),
    [
        ("drake", True),
        ("drake_srg", True),
        ("drake_srg_sources", True),
        ("python", False),
        ("processor", False),
    ],
)
def test_only_versions_that_can_change_rows_count(name, decisive):
    here = current_versions()
    there = {**here, name: "other"}
    expected = (name, "other", here[name]) if decisive else None
    assert version_difference(there, here) == expected


def test_a_changed_material_of_a_users_mesh_is_a_difference(tmp_path):
    mesh, paint = tmp_path / "drill.obj", tmp_path / "drill.mtl"
    mesh.write_text("mtllib drill.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    paint.write_text("newmtl a\nKd 1 0 0\n")
    tree = {
        "objects": {
            "drill": {"model": str(mesh)},
            "can": {"model": "package://drake_srg/sdf/can.sdf"},
            "gone": {"model": str(tmp_path / "gone.obj")},
        }
    }
    before = hash_model_files(tree)
    assert list(before) == [str(mesh)]
    assert hash_model_files(tree) == before
    paint.write_text("newmtl a\nKd 0 0 1\n")
    told = difference(changed(files=before), changed(files=hash_model_files(tree)))
    assert told.startswith(f"{mesh}: was {before[str(mesh)]}, is ")


def test_equal_trees_give_equal_text():
    assert dump_tree(TREE) == dump_tree(dict(reversed(TREE.items())))
