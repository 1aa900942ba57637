"""Files of a scenario's models, written into a folder."""

from __future__ import annotations

import dataclasses as dc
import errno
import os
import re
import tempfile
from pathlib import Path

from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError, suggest
from drake_srg.export.describe import PlantReader, read_constraints
from drake_srg.export.mjcf import Wires, find_wires, to_mjcf
from drake_srg.export.model import FOLDER, Meshes, Model
from drake_srg.export.sdf import to_sdf
from drake_srg.export.urdf import to_urdf
from drake_srg.scenario import Scenario
from drake_srg.scenario.schema import check_single_arm
from drake_srg.station.plant import AddPlant

# Formats, and the suffixes of their files.
FORMATS = {"urdf": ".urdf", "mjcf": ".xml", "sdf": ".sdf"}
_SCENE = "scene"


@dc.dataclass(frozen=True)
class ExportedModel:
    """A file that was written.

    Attributes:
        path: The file.
        model: The model in it.
        wires: The wires in it.
    """

    path: Path
    model: Model
    wires: Wires | None = None


def export_scenario(scenario: Scenario, kind: str, out: Path) -> list[ExportedModel]:
    """Write a scenario's models: a file for each, and a file with the whole scene.

    Meshes go into a folder `meshes` beside these files. Existing files with the same
    names are replaced.

    Args:
        scenario: The scenario, drawn.
        kind: One of `FORMATS`.
        out: The folder.

    Returns:
        The files, the one with the whole scene last.

    Raises:
        ScenarioError: If a format cannot hold a model.
        OSError: If a file cannot be written.
    """
    if kind not in FORMATS:
        raise ScenarioError(f"format {kind!r}: unknown {suggest(kind, FORMATS)}")
    check_single_arm(scenario, "export")
    driver = scenario.gripper
    if kind != "mjcf" and driver is not None and driver.wire_motor is not None:
        # These formats have no tendons. Without the driver, the joints keep the model's
        # own share of the motor.
        scenario = dc.replace(scenario, gripper=None)
    builder = DiagramBuilder()
    plant, graph = AddPlant(builder, scenario, catch=False)
    reader = PlantReader(plant, graph, read_constraints(scenario))
    if _SCENE in reader.instances:
        raise ScenarioError(f"directives: {_SCENE}: reserved for the scene's own file")
    diagram = builder.Build()  # keeps plant and graph alive
    models = [reader.one(instance) for instance in reader.instances]
    models.append(reader.all(_SCENE))

    meshes, texts, exported = Meshes(), {}, []
    for model in models:
        wires = None
        if kind == "urdf":
            text = to_urdf(model, meshes)
        elif kind == "sdf":
            text = to_sdf(model, meshes)
        else:
            if model.name in (_SCENE, "gripper"):
                prefix = "gripper_" if model.name == _SCENE else ""
                wires = find_wires(model, driver, prefix)
            text = to_mjcf(model, meshes, wires)
        name = _file_name(model.name) + FORMATS[kind]
        texts[name] = text
        exported.append(ExportedModel(out / name, model, wires))
    del diagram
    files = texts | {f"{FOLDER}/{n}.obj": text for n, text in meshes.texts.items()}
    _write(files, out)
    return exported


def _file_name(name: str) -> str:
    return re.sub(r"[^\w.-]", "_", name)


def _write(files: dict[str, str], out: Path) -> None:
    """Write files into a folder: all of them, or none."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".export.", dir=out) as folder:
        for name, text in files.items():
            path = Path(folder) / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        if any((taken := out / name).is_dir() for name in files):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(taken))
        for path in {(out / name).parent for name in files}:
            path.mkdir(exist_ok=True)
        for name in files:
            (Path(folder) / name).replace(out / name)
