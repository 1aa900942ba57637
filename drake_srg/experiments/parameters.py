"""Parameters of experiments: the keyword arguments of their functions `run`."""

from __future__ import annotations

import ast
import collections.abc
import dataclasses as dc
import re
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from drake_srg.common.exceptions import ScenarioError, suggest


@dc.dataclass(frozen=True)
class Parameter:
    """A keyword argument of an experiment's `run`.

    Attributes:
        default: The value that the experiment uses without an override.
        description: From the docstring of `run`.
    """

    default: Any
    description: str


def read_parameters(run: ast.FunctionDef) -> dict[str, Parameter]:
    """Return the keyword arguments of a function `run`, whose defaults are literals."""
    described = re.findall(
        r"^    (\w+): (.*(?:\n {8}.*)*)", ast.get_docstring(run) or "", re.MULTILINE
    )
    texts = {name: " ".join(text.split()) for name, text in described}
    arguments = zip(run.args.kwonlyargs, run.args.kw_defaults, strict=True)
    return {
        argument.arg: Parameter(
            ast.literal_eval(default) if default else None,
            texts.get(argument.arg, ""),
        )
        for argument, default in arguments
    }


def split_overrides(
    name: str, allowed: Mapping[str, Parameter], overrides: Iterable[str]
) -> dict[str, str]:
    """Return the text of each override by the name of its parameter.

    Args:
        name: Of the experiment, for errors.
        allowed: Its parameters.
        overrides: `KEY=VALUE` each.

    Raises:
        ScenarioError: If an override lacks a key or names an unknown parameter.
    """
    texts = {}
    for override in overrides:
        key, equals, text = override.partition("=")
        if not (key and equals):
            raise ScenarioError(f"--set {override}: must be KEY=VALUE")
        if not allowed:
            raise ScenarioError(f"experiment {name}: takes no parameters, got {key!r}")
        if key not in allowed:
            hint = suggest(key, allowed)
            raise ScenarioError(f"experiment {name}: unknown key {key!r} {hint}")
        texts[key] = text
    return texts


def parse_values(
    name: str, run: Callable[..., Any], texts: Mapping[str, str]
) -> dict[str, Any]:
    """Return values for parameters of a function `run`, checked by its type hints.

    Numbers must be positive: they are counts, times, masses, forces and the like.

    Args:
        name: Of the experiment, for errors.
        run: Its function.
        texts: YAML by parameter.

    Raises:
        ScenarioError: If a value does not fit its parameter.
    """
    hints = typing.get_type_hints(run)
    origin = f"experiment {name}"
    return {key: _parse(text, hints[key], origin, key) for key, text in texts.items()}


def _parse(text: str, hint: Any, origin: str, key: str) -> Any:
    from drake_srg.scenario.typed_yaml import check_tree, fail, parse_yaml

    value = parse_yaml(f"value: {text}", f"--set {key}")["value"]
    if typing.get_origin(hint) is typing.Literal:
        allowed = typing.get_args(hint)
        if value not in allowed:
            fail(origin, key, f"must be one of {', '.join(allowed)}; got {value!r}")
        return value
    many = typing.get_origin(hint) is collections.abc.Sequence
    # Made from the hint, which mypy does not follow.
    schema = list[typing.get_args(hint)] if many else hint  # type: ignore[misc]  # a type by value
    value = check_tree(value, schema, origin, key)
    items = value if many else [value]
    if not items:
        fail(origin, key, "needs at least one entry")
    for item in items:
        if isinstance(item, (int, float)) and not item > 0:
            fail(origin, key, f"must be greater than 0, got {item}")
    return tuple(items) if many else value
