"""Constraints of models that a scenario's solver would ignore or refuse.

Drake 1.51 warns of some of them in its log, refuses some in the first step, and reads
over some without a word. Here each ends before there is a plant.
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

from drake_srg.common.exceptions import ScenarioError
from drake_srg.parsing import configure_parser
from drake_srg.scenario import Scenario, is_continuous

# Elements that make constraints, by the ending of the model's file.
_ELEMENTS = {
    ".sdf": ("drake:mimic", "drake:ball_constraint", "drake:tendon_constraint"),
    ".urdf": ("mimic", "drake:ball_constraint", "drake:tendon_constraint"),
    ".xml": ("connect",),  # MuJoCo's
}
_SAP = "discrete_contact_approximation sap, similar or lagged"


def check_constraints(scenario: Scenario) -> None:
    """Check that the scenario's solver takes all constraints of its models.

    Raises:
        ScenarioError: If it does not, with the model, the solver and what is allowed.
    """
    for model, path in model_files(scenario):
        text = re.sub("<!--.*?-->", "", path.read_text("utf-8"), flags=re.DOTALL)
        found = [e for e in _ELEMENTS.get(path.suffix, ()) if _count(e, text)]
        for element, why in (
            *_read_over(path.suffix, text),
            *((element, _refused(element, scenario)) for element in found),
        ):
            if why:
                raise ScenarioError(
                    f"directives: {model}: {path.name} has <{element}>, {why}"
                )


def _refused(element: str, scenario: Scenario) -> str:
    """Why the solver does not take an element, and what is allowed; empty: it does."""
    if is_continuous(scenario):
        if element.endswith("mimic"):
            return ""
        return (
            "which integrator cenic refuses (allowed: <drake:mimic>, or "
            f"plant_config.time_step greater than 0.0 with {_SAP})"
        )
    if scenario.plant_config.discrete_contact_approximation == "tamsi":
        return f"which tamsi does not take (allowed: {_SAP})"
    return ""


def _read_over(suffix: str, text: str) -> Iterator[tuple[str, str]]:
    """Elements that Drake ignores without a word, and what is allowed."""
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
    """Name and file of each model among the directives, and of what these include.

    What cannot be found is left out: the parser will say so.
    """
    plant = MultibodyPlant(time_step=0.0)  # a parser does not keep its own
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
    """Return a scenario's directives with those of other files in place of their names.

    Raises:
        RuntimeError: (Drake's) if a file cannot be read.
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
