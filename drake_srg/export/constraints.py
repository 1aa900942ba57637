"""Constraints between joints and links, read from model files.

Python cannot ask a plant for them.
"""

from __future__ import annotations

import dataclasses as dc
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping

import numpy as np

from drake_srg.export.model import Loop, Mimic
from drake_srg.objects.meshes.xml_file import read_xml
from drake_srg.objects.sdf import DRAKE
from drake_srg.scenario import Scenario
from drake_srg.station.preflight import model_files

_BALL = f"{{{DRAKE}}}ball_constraint"


@dc.dataclass(frozen=True)
class Constraints:
    """Constraints of a model.

    Attributes:
        mimics: By the name of the joint that follows.
        loops: Pins that close its loops.
    """

    mimics: Mapping[str, Mimic] = dc.field(default_factory=dict)
    loops: tuple[Loop, ...] = ()


def read_constraints(scenario: Scenario) -> dict[str, Constraints]:
    """Return the constraints of a scenario's models, by the models' names.

    Raises:
        ScenarioError: If a model's file cannot be read.
    """
    found = {}
    for name, path in model_files(scenario):
        if path.suffix in (".sdf", ".urdf"):
            root = read_xml(path, warnings=[])
            found[name] = Constraints(dict(_mimics(root)), tuple(_loops(root)))
    return found


def _mimics(root: ET.Element) -> Iterator[tuple[str, Mimic]]:
    for joint in root.iter("joint"):
        for mimic in (*joint.findall(f"{{{DRAKE}}}mimic"), *joint.findall("mimic")):
            multiplier = float(mimic.get("multiplier", 1.0))
            offset = float(mimic.get("offset", 0.0))
            yield (
                joint.get("name", ""),
                Mimic(mimic.get("joint", ""), multiplier, offset),
            )


def _loops(root: ET.Element) -> Iterator[Loop]:
    for ball in root.iter(_BALL):

        def value(part: str, ball: ET.Element = ball) -> str:
            # SDF has values as text, URDF as attributes.
            child = ball.find(f"{_BALL}_{part}")
            if child is None:
                return ""
            return child.text or child.get("name") or child.get("value") or ""

        a, b = (np.array(value(p).split(), float) for p in ("p_AP", "p_BQ"))
        yield Loop(ball.get("name", "loop"), (value("body_A"), value("body_B")), (a, b))
