"""Readers of models, with `package://drake_srg/` URLs for a checkout and a wheel."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pydrake.math import RigidTransform
from pydrake.multibody.parsing import (
    GetScopedFrameByName,
    ModelDirective,
    ModelDirectives,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

_URL = "package://drake_srg/"
_PACKAGE = Path(__file__).resolve().parent


def models_path() -> Path:
    """Return the folder that holds `package.xml`, `sdf/` and `meshes/`.

    A wheel carries it inside the package, a checkout beside the package.

    Raises:
        FileNotFoundError: if neither exists.
    """
    candidates = (_PACKAGE / "models", _PACKAGE.parent / "models")
    for path in candidates:
        if (path / "package.xml").is_file():
            return path
    raise FileNotFoundError(
        "drake_srg's models are missing: no package.xml in "
        + " or ".join(str(path) for path in candidates)
        + ". Reinstall the package, or run it from a complete checkout."
    )


def configure_parser(parser: Parser) -> None:
    """Make `parser` resolve `package://drake_srg/` to the models folder.

    A parser that already maps the package to that folder stays as it is.

    Raises:
        ValueError: if the parser maps the package to another folder.
    """
    path = str(models_path())
    packages = parser.package_map()
    if packages.Contains("drake_srg"):
        known = packages.GetPath("drake_srg")
        if Path(known).resolve() == Path(path).resolve():
            return
        raise ValueError(
            f"This parser already maps package 'drake_srg' to {known}, not to {path}."
        )
    packages.Add("drake_srg", path)


def AddModel(
    plant: MultibodyPlant, file: str | Path, name: str | None = None
) -> ModelInstanceIndex:
    """Add the single model of a file to a plant.

    Drake's parser takes 30 ms for any SDF file, but less than 1 ms for the same text,
    so it gets our own models as text. Other files may contain relative paths, which
    text would not resolve.

    Args:
        plant: Not yet finalized.
        file: Its path, or a URL such as `package://drake_srg/sdf/srg.sdf`.
        name: Name of the model instance. None keeps the file's, with a suffix if it is
            taken.

    Raises:
        FileNotFoundError: If there is no file at the path.
        RuntimeError: If Drake cannot read the file, or the name is taken.
    """
    parser = Parser(plant)
    configure_parser(parser)
    parser.SetAutoRenaming(True)
    url = str(file)
    path = models_path() / url.removeprefix(_URL)
    if _is_own(url) and path.is_file():
        text = path.read_text("utf-8")
        (model,) = parser.AddModels(file_contents=text, file_type="sdf")
    elif "://" in url:
        (model,) = parser.AddModels(url=url)
    else:
        if not Path(file).is_file():
            raise FileNotFoundError(f"{file}: no such file (allowed: a path or a URL)")
        (model,) = parser.AddModels(Path(file).resolve())
    if name is not None:
        plant.RenameModelInstance(model, name)
    return model


def AddDirectives(plant: MultibodyPlant, directives: Iterable[ModelDirective]) -> None:
    """Add the models, frames and welds of model directives to a plant; see `AddModel`.

    Raises:
        RuntimeError: If Drake cannot process a directive, or a frame is unknown.
    """
    parser = Parser(plant)
    configure_parser(parser)
    for directive in directives:
        model = directive.add_model
        plain = model is not None and not (
            model.default_joint_positions or model.default_free_body_pose
        )
        if plain and _is_own(model.file):
            AddModel(plant, model.file, model.name)
        elif (weld := directive.add_weld) is not None:
            # Drake's function welds only models that the same call has added.
            parent = GetScopedFrameByName(plant, weld.parent)
            child = GetScopedFrameByName(plant, weld.child)
            X_PC = weld.X_PC.GetDeterministicValue() if weld.X_PC else RigidTransform()
            plant.WeldFrames(parent, child, X_PC)
        else:
            ProcessModelDirectives(ModelDirectives(directives=[directive]), parser)


def _is_own(url: str) -> bool:
    return url.startswith(_URL) and url.endswith(".sdf")


def resolve_url(url: str) -> Path:
    """Return the file that a URL such as `package://drake_srg/sdf/mug.sdf` names.

    Raises:
        RuntimeError: If its package is unknown or the file does not exist.
    """
    plant = MultibodyPlant(time_step=0.0)  # the parser does not keep it alive
    parser = Parser(plant)
    configure_parser(parser)
    return Path(parser.package_map().ResolveUrl(url))
