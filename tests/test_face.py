"""The names that `import drake_srg` offers."""

import ast
import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

import drake_srg

STUB = Path(drake_srg.__file__).with_suffix(".pyi")
NAMES = [name for name in drake_srg.__all__ if name != "__version__"]


@pytest.mark.parametrize("name", NAMES)
def test_each_name_is_the_object_of_its_home(name):
    found = getattr(drake_srg, name)
    assert found.__name__ == name
    assert found.__module__.startswith("drake_srg.")


def test_the_version_is_that_of_the_installed_package():
    assert drake_srg.__version__ == importlib.metadata.version("drake_srg")


def test_type_checkers_see_the_same_names():
    tree = ast.parse(STUB.read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    stated = {alias.asname for node in imports for alias in node.names}
    assert stated == set(NAMES)
    assert STUB.with_name("py.typed").is_file()


def test_dir_lists_the_face():
    assert set(drake_srg.__all__) <= set(dir(drake_srg))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'Simulat'"):
        _ = drake_srg.Simulat


def test_importing_the_package_imports_neither_drake_nor_numpy():
    code = "import sys, drake_srg; print(*{'numpy', 'pydrake'} & set(sys.modules))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
