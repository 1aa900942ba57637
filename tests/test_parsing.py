from __future__ import annotations

from pathlib import Path

import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from drake_srg import parsing


def make_parser() -> Parser:
    return Parser(MultibodyPlant(0.0))


def fake_package(folder: Path) -> Path:
    package = folder / "drake_srg"
    package.mkdir(parents=True)
    return package


def add_models(folder: Path) -> Path:
    folder.mkdir()
    (folder / "package.xml").write_text("<package/>")
    return folder


def test_urls_resolve_from_a_checkout():
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parsing.configure_parser(parser)
    (model,) = parser.AddModelsFromUrl("package://drake_srg/sdf/srg.sdf")
    assert plant.GetModelInstanceName(model) == "srg"


def test_configuring_a_parser_twice_changes_nothing():
    parser = make_parser()
    parsing.configure_parser(parser)
    parsing.configure_parser(parser)
    assert parser.package_map().GetPath("drake_srg") == str(parsing.models_path())


def test_another_package_of_the_same_name_is_refused(tmp_path):
    parser = make_parser()
    parser.package_map().Add("drake_srg", str(add_models(tmp_path / "models")))
    with pytest.raises(ValueError, match="already maps package 'drake_srg'"):
        parsing.configure_parser(parser)


def test_a_wheel_carries_the_models_inside_the_package(tmp_path, monkeypatch):
    package = fake_package(tmp_path)
    inside = add_models(package / "models")
    add_models(tmp_path / "models")
    monkeypatch.setattr(parsing, "_PACKAGE", package)
    assert parsing.models_path() == inside


def test_a_checkout_has_the_models_beside_the_package(tmp_path, monkeypatch):
    beside = add_models(tmp_path / "models")
    monkeypatch.setattr(parsing, "_PACKAGE", fake_package(tmp_path))
    assert parsing.models_path() == beside


def test_the_error_for_missing_models_names_both_places(tmp_path, monkeypatch):
    package = fake_package(tmp_path)
    monkeypatch.setattr(parsing, "_PACKAGE", package)
    with pytest.raises(FileNotFoundError, match="models are missing") as error:
        parsing.models_path()
    assert str(package / "models") in str(error.value)
    assert str(tmp_path / "models") in str(error.value)
