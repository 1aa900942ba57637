"""Checks of a scenario's visual servo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drake_srg.scenario.schema import Scenario


def servoing_problems(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yield the key and the description of each problem of `servoing`."""
    servoing = scenario.servoing
    if servoing is None:
        return
    for key, given in (
        ("script", bool(scenario.script)),
        ("taught", scenario.taught is not None),
        ("task.clear", scenario.task.clear is not None),
    ):
        if given:
            yield "servoing", f"must be null with {key}"
    if servoing.camera not in scenario.cameras:
        allowed = ", ".join(scenario.cameras) or "none"
        problem = f"unknown camera {servoing.camera!r} (allowed: {allowed})"
        yield "servoing.camera", problem
    images = servoing.camera_period / servoing.period
    if images < 1.0 or abs(images - round(images)) > 1e-6:
        yield (
            "servoing.camera_period",
            f"must be a multiple of servoing.period ({servoing.period:g} s), "
            f"got {servoing.camera_period:g}",
        )
