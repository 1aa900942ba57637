"""requirements.lock pins what pyproject.toml asks for, on every supported Python."""

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "requirements.lock").read_text("utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]

# Too large to install for everybody; pinned in pyproject.toml instead.
LEFT_OUT = {"lerobot", "onnx", "stable-baselines3", "tensorboard", "torch"}


def needed(lines, python):
    """Requirements of a Linux machine, by the canonical names of the packages."""
    here = {
        "implementation_name": "cpython",
        "platform_machine": "x86_64",
        "platform_python_implementation": "CPython",
        "python_full_version": f"{python}.1",
        "python_version": python,
        "sys_platform": "linux",
    }
    requirements = [Requirement(line) for line in lines]
    return [
        (canonicalize_name(r.name), r.specifier)
        for r in requirements
        if r.marker is None or r.marker.evaluate(here)
    ]


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
def test_every_requirement_has_one_pin_that_meets_it(python):
    lines = [line for line in LOCK.splitlines() if not line.startswith("#")]
    pairs = needed(lines, python)
    pins = {name: str(pin).removeprefix("==") for name, pin in pairs}
    assert len(pins) == len(pairs)
    extras = PROJECT["optional-dependencies"].values()
    wanted = [*PROJECT["dependencies"], *(line for extra in extras for line in extra)]
    assert len(wanted) > 20
    for name, specifier in needed(wanted, python):
        if name in LEFT_OUT:
            assert str(specifier).startswith("==")
            assert name not in pins
        else:
            assert pins[name] in specifier


def test_the_lock_names_no_registry():
    assert "://" not in LOCK
    assert "--" not in LOCK
