"""Packages that read exported models, imported only by the worker that uses them."""

import importlib

import pytest


@pytest.fixture(scope="session")
def mujoco():
    return importlib.import_module("mujoco")


@pytest.fixture(scope="session")
def yourdfpy():
    return importlib.import_module("yourdfpy")
