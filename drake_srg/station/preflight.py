"""Finds constraints of models that a scenario's solver would ignore or refuse.

Drake refuses some of them in the first step, logs a warning for some, and silently
ignores others. This module reports all of them before the plant is built.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from pydrake.multibody.parsing import (
    FlattenModelDirectives,
    ModelDirectives,
    PackageMap,
    Parser,
)
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.common.drake_version import NEWER_DRAKE, takes_loop_constraints
from drake_srg.common.exceptions import ScenarioError
from drake_srg.parsing import configure_parser
from drake_srg.scenario import Scenario, is_continuous

# Elements that define constraints, by the suffix of the model's file.
_ELEMENTS = {
    ".sdf": ("drake:mimic", "drake:ball_constraint", "drake:tendon_constraint"),
    ".urdf": ("mimic", "drake:ball_constraint", "drake:tendon_constraint"),
    ".xml": ("connect",),  # MuJoCo
}
_SAP = "discrete_contact_approximation sap, similar or lagged"


def check_constraints(scenario: Scenario) -> None:
    """Check that the scenario's solver supports all constraints of its models.

    Raises:
        ScenarioError: If it does not. Names the model, the solver and what is allowed.
    """
    for model, path in model_files(scenario):
        text = re.sub("<!--.*?-->", "", path.read_text("utf-8"), flags=re.DOTALL)
        found = [e for e in _ELEMENTS.get(path.suffix, ()) if _count(e, text)]
        for element, why in (
            *_ignored(path.suffix, text),
            *((element, _refused(element, scenario)) for element in found),
        ):
            if why:
                raise ScenarioError(
                    f"directives: {model}: {path.name} has <{element}>, {why}"
                )


def _refused(element: str, scenario: Scenario) -> str:
    """Return why the solver refuses an element and what is allowed, else empty text."""
    if is_continuous(scenario):
        discrete = f"plant_config.time_step greater than 0.0 with {_SAP}"
        if element.endswith("tendon_constraint"):
            return f"which integrator cenic refuses (allowed: {discrete})"
        if element.endswith("mimic") or takes_loop_constraints():
            return ""
        return (
            "which integrator cenic refuses on this Drake (allowed: <drake:mimic>, "
            f"{NEWER_DRAKE}, or {discrete})"
        )
    if scenario.plant_config.discrete_contact_approximation == "tamsi":
        return f"which tamsi does not support (allowed: {_SAP})"
    return ""


def _ignored(suffix: str, text: str) -> Iterator[tuple[str, str]]:
    """Yield elements that Drake silently ignores, and what is allowed instead."""
    why = "which Drake ignores (allowed: {})"
    if suffix == ".urdf" and _count("drake:mimic", text):
        yield "drake:mimic", why.format("<mimic>")
    if suffix == ".sdf":
        outside = re.sub(r"<axis\b.*?</axis>", "", text, flags=re.DOTALL)
        effective = _count("drake:mimic", outside)
        for element in ("mimic", "drake:mimic"):
            if _count(element, text) > effective:
                yield element, why.format("<drake:mimic> directly in the joint")


def _count(element: str, text: str) -> int:
    return len(re.findall(rf"<{element}\b", text))


def model_files(scenario: Scenario) -> Iterator[tuple[str, Path]]:
    """Yield name and file of each model in the directives, and of included models.

    Files that cannot be found are left out; the parser reports them.
    """
    plant = MultibodyPlant(time_step=0.0)  # the parser does not keep it alive
    parser = Parser(plant)
    configure_parser(parser)
    try:
        flat = flat_directives(scenario, parser)
    except RuntimeError:
        return
    for directive in flat.directives:
        if (model := directive.add_model) is not None:
            for path in _with_includes(model.file, parser.package_map()):
                yield model.name, path


def flat_directives(scenario: Scenario, parser: Parser) -> ModelDirectives:
    """Return a scenario's directives, with included files replaced by their contents.

    Raises:
        RuntimeError: If Drake cannot read a file.
    """
    return FlattenModelDirectives(
        ModelDirectives(directives=scenario.directives), parser.package_map()
    )


def _with_includes(url: str, packages: PackageMap) -> Iterator[Path]:
    try:
        path = Path(packages.ResolveUrl(url))
        text = path.read_text("utf-8")
    except (RuntimeError, OSError, UnicodeError):
        return
    yield path
    for included in re.findall(
        r"<include>.*?<uri>\s*(\S+?)\s*</uri>.*?</include>", text, flags=re.DOTALL
    ):
        yield from _with_includes(included, packages)
