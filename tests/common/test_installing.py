import ctypes
import math
import sys
from pathlib import Path

import pytest

from drake_srg.common import installing
from drake_srg.common.installing import (
    LIBRARIES,
    apt_install,
    library_fix,
    pip_install,
    require,
    require_rendering,
    this_package,
    with_install_hint,
)

CHECKOUT = Path(__file__).resolve().parents[2]


def test_the_install_command_is_for_this_interpreter():
    assert pip_install(*this_package("sweep")) == (
        f"{sys.executable} -m pip install -e '{CHECKOUT}[sweep]'"
    )


def test_a_checkout_is_installed_in_place_and_a_release_by_name(tmp_path, monkeypatch):
    assert this_package() == ["-e", str(CHECKOUT)]
    module = tmp_path / "site-packages" / "drake_srg" / "common" / "installing.py"
    monkeypatch.setattr(installing, "__file__", str(module))
    assert this_package() == ["drake_srg"]
    assert this_package("sweep") == ["drake_srg[sweep]"]


def test_a_required_module_is_imported():
    assert require("math", "sweep", "Sweeps needs") is math


def test_a_missing_module_is_named_with_the_command_that_installs_it():
    with pytest.raises(
        ImportError, match=r"^Sweeps needs 'nothing_here', .* -m pip .*\[sweep\]"
    ):
        require("nothing_here.at_all", "sweep", "Sweeps needs")


@pytest.mark.parametrize("missing", LIBRARIES)
def test_a_missing_library_is_named_with_the_line_that_installs_all(
    monkeypatch, missing
):
    def load(name):
        if name == missing:
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", load)
    with pytest.raises(ImportError, match=rf"{missing}, .* install .* libegl1 libgl1$"):
        require_rendering()


def test_only_root_needs_no_sudo(monkeypatch):
    monkeypatch.setattr(installing.os, "geteuid", lambda: 0)
    assert "sudo" not in apt_install("graphviz")
    monkeypatch.setattr(installing.os, "geteuid", lambda: 1000)
    assert apt_install("graphviz").count("sudo apt-get") == 2


def test_only_errors_about_a_library_get_its_line():
    missing = "libglib-2.0.so.0: cannot open shared object file"
    assert library_fix(missing).endswith("libglib2.0-0 libegl1 libgl1")
    assert library_fix("No module named 'av'") == ""
    assert with_install_hint(missing).count("libegl1") == 1
    assert with_install_hint(with_install_hint(missing)).count("libegl1") == 1
