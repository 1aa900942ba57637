"""The public API: the faces of the package and of its rooms."""

import ast
import enum
import importlib
import importlib.metadata
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import drake_srg

PACKAGE = Path(drake_srg.__file__).parent
ROOT = PACKAGE.parent
STUBS = sorted([PACKAGE / "__init__.pyi", *PACKAGE.glob("*/__init__.pyi")])
# Rooms without a face: of data, and of the command line.
NO_FACE = {"cli", "importing", "models", "scenarios"}
# Modules whose public names are all public, and what a page of docs imports besides:
# a module that makes environments known, a policy's own package, and DDS types, which
# need an optional package.
WHOLE = {"drake_srg.types", "drake_srg.lifetime"}
BESIDE_FACES = {
    "drake_srg.learning.envs",
    "drake_srg.robot.serve.dex1.messages",
    "drake_srg.suite.lerobot",
}


def package_of(stub):
    return ".".join(stub.parent.relative_to(ROOT).parts)


def stated(stub):
    """The names of a face by the modules that they come from."""
    tree = ast.parse(stub.read_text(encoding="utf-8"))
    lines = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    assert all(len(line.names) == 1 for line in lines)
    return {line.names[0].asname: line.module for line in lines}


FACES = {package_of(stub): stated(stub) for stub in STUBS}
NAMES = [(package, name) for package, names in FACES.items() for name in names]


def test_every_room_has_a_face():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert rooms - NO_FACE == {path.parent.name for path in STUBS[1:]}
    assert (PACKAGE / "py.typed").is_file()


@pytest.mark.parametrize(("package", "name"), NAMES)
def test_each_name_is_the_object_of_its_home(package, name):
    home = importlib.import_module(FACES[package][name])
    found = getattr(importlib.import_module(package), name)
    assert found is getattr(home, name)
    if inspect.isclass(found) or inspect.isfunction(found):
        assert inspect.getdoc(found)
    if inspect.isclass(found) and not issubclass(found, (Exception, enum.Enum)):
        assert [*inspect.signature(found).parameters] != ["args", "kwargs"]


@pytest.mark.parametrize("package", FACES)
def test_a_package_lists_its_face(package):
    module = importlib.import_module(package)
    assert module.__all__ == list(FACES[package])
    assert set(module.__all__) <= set(dir(module))
    with pytest.raises(AttributeError, match=f"{package}' has no attribute 'Simulat'"):
        _ = module.Simulat


def test_the_version_is_that_of_the_installed_package():
    assert drake_srg.__version__ == importlib.metadata.version("drake_srg")


@pytest.mark.parametrize("package", FACES)
def test_importing_a_face_imports_neither_drake_nor_numpy(package):
    code = f"import sys, {package}; print(*{{'numpy', 'pydrake'}} & set(sys.modules))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def programs():
    """Yield what users read: pages, notebooks, examples and the project template."""
    for folder, pattern in (("docs", "*.md"), ("examples", "*.py")):
        for path in sorted((ROOT / folder).rglob(pattern)):
            yield path, path.read_text("utf-8")
    for path in sorted((PACKAGE / "cli/project").rglob("*.in")):
        yield path, path.read_text("utf-8")
    yield ROOT / "README.md", (ROOT / "README.md").read_text("utf-8")
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        for cell in json.loads(path.read_text("utf-8"))["cells"]:
            if cell["cell_type"] == "code":
                yield path, "".join(cell["source"])


def test_what_users_read_imports_from_faces():
    line = r"^ *from (drake_srg[\w.]*) import (\([^)]*\)|[^\n(]+)$"
    count = 0
    for path, text in programs():
        for module, listed in re.findall(line, text, re.MULTILINE):
            names = re.findall(r"(\w+)(?: as \w+)?(?:,|\s|\)|$)", listed)
            count += len(names)
            if module not in WHOLE | BESIDE_FACES:
                assert module in FACES, f"{path}: {module} is private"
                private = set(names) - {*FACES[module], "__version__"}
                assert not private, f"{path}: {module} has no {private} on its face"
    assert count > 50


PROGRAM = """
from drake_srg.gripper import GripperServo, TendonDrive, TendonDriveConfig

reveal_type(GripperServo)
reveal_type(TendonDrive(TendonDriveConfig(), 0.001))
TendonDrive(0.001)
"""


# It stays, so that only what has changed is checked anew.
CACHE = ROOT / ".mypy_cache" / "face"


@pytest.mark.slow
def test_type_checkers_see_classes(tmp_path):
    text = (ROOT / "docs/reference/index.md").read_text("utf-8")
    (lines,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (tmp_path / "pyproject.toml").write_text("[tool.mypy]\nstrict = true\n" + lines)
    (tmp_path / "program.py").write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", str(CACHE), "program.py"],
        cwd=tmp_path,
        env={"MYPYPATH": str(ROOT), "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    told = [line for line in done.stdout.splitlines() if line.startswith("program.py")]
    servo = "def (config: drake_srg.gripper.servo.GripperServoConfig) -> "
    assert servo in told[0]
    assert '"drake_srg.gripper.tendon.TendonDrive"' in told[1]
    assert "error" in told[2]
    assert len(told) == 4  # TendonDrive(0.001) lacks an argument of the right type
