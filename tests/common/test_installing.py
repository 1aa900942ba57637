import math
import sys
from pathlib import Path

import pytest

from drake_srg.common import installing
from drake_srg.common.installing import pip_install, require, this_package

CHECKOUT = Path(__file__).resolve().parents[2]


def test_the_install_command_is_for_this_interpreter():
    assert pip_install(*this_package("recording")) == (
        f"{sys.executable} -m pip install -e '{CHECKOUT}[recording]'"
    )


def test_a_checkout_is_installed_in_place_and_a_release_by_name(tmp_path, monkeypatch):
    assert this_package() == ["-e", str(CHECKOUT)]
    module = tmp_path / "site-packages" / "drake_srg" / "common" / "installing.py"
    monkeypatch.setattr(installing, "__file__", str(module))
    assert this_package() == ["drake_srg"]
    assert this_package("sweep") == ["drake_srg[sweep]"]


def test_a_required_module_is_imported():
    assert require("math", "recording", "Recording needs") is math


def test_a_missing_module_is_named_with_the_command_that_installs_it():
    with pytest.raises(
        ImportError, match=r"^Recording needs 'nothing_here', .* -m pip .*\[recording\]"
    ):
        require("nothing_here.at_all", "recording", "Recording needs")
