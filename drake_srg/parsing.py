"""Resolve `package://drake_srg/...`, in a checkout and in an installed wheel."""

from __future__ import annotations

from pathlib import Path

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

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


def resolve_url(url: str) -> Path:
    """Return the file that a URL such as `package://drake_srg/sdf/mug.sdf` names.

    Raises:
        RuntimeError: If its package is unknown or the file does not exist.
    """
    plant = MultibodyPlant(time_step=0.0)  # the parser does not keep it alive
    parser = Parser(plant)
    configure_parser(parser)
    return Path(parser.package_map().ResolveUrl(url))
