"""Labelled grasps of one object: sampled, tested on the bench, written to a file.

The YAML is an Isaac grasp file (NVIDIA's specification:
https://nvidia-isaac-ros.github.io/concepts/manipulation/isaac_grasp.html). GraspGen
writes such files (`save_to_isaac_grasp_format` in grasp_gen/dataset/eval_utils.py), and
so does GraspDataGen. For each grasp, the specification has `confidence`, `position` and
`orientation` of the gripper's frame in the object's, `cspace_position` and
`pregrasp_cspace_position`. We add our labels.

The gripper's frame is our palm: it approaches along x and closes along y. GraspGen's
own frame approaches along z and closes along x: it is the palm's frame, turned by the
quaternion (w, x, y, z) = (0.5, 0.5, 0.5, 0.5).
"""

from __future__ import annotations

import collections
import dataclasses as dc
import functools
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydrake.geometry import ClippingRange
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.geometry import look_at
from drake_srg.learning.grasp_bench import HANDS, GraspBench, GraspLabel
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import (
    FIELD_OF_VIEW,
    AddStudio,
    Image,
    contact_sheet,
    photograph,
)
from drake_srg.objects.models import AddObject, object_body
from drake_srg.objects.solids import object_pieces
from drake_srg.parsing import configure_parser, resolve_url
from drake_srg.planning.grasps.sampled_grasps import sample_grasps
from drake_srg.sweeps.engines import Engine
from drake_srg.sweeps.files import write_file
from drake_srg.sweeps.rows import require_sweep

# In the pictures, the hand lies along x, and its fingers end here [m].
_FINGERS_END, _PIXELS = 0.2, 200
_EYE = np.array([0.35, -0.5, 0.8])
_LIGHTS = (([-0.4, 0.8, -1.0], 1.0), ([0.2, 0.3, -0.8], 1.0))

SUFFIXES = (".yaml", ".yml", ".parquet")
# After this many directions without a grasp, the object counts as too large or small.
_HOPELESS = 40


@dc.dataclass(frozen=True)
class LabelJob:
    """A labelling task: the object, the hand and the physics.

    Attributes:
        name: Name of the object, for files and messages.
        model: Path or URL of its model.
        scale: Metres per unit of a mesh.
        hand: One of `HANDS`.
        physics: `train`, `fast` or `accurate`.
        seed: Seed of the samples.
    """

    name: str
    model: str
    scale: float = 1.0
    hand: str = "srg"
    physics: str = "train"
    seed: int = 0

    @property
    def object(self) -> ObjectConfig:
        """The object."""
        return ObjectConfig(model=self.model, scale=self.scale)


def label_direction(job: LabelJob, direction: int) -> list[GraspLabel]:
    """Return the labels of all grasps that are sampled from one direction.

    Grasps whose open hand already touches the object are left out.
    """
    solid, p_OC = object_pieces(job.name, job.object)
    fingers = HANDS[job.hand].fingers
    grasps = sample_grasps(fingers, solid.translated(p_OC), job.seed, direction)
    labels = map(_bench(job, job.physics).label, grasps)
    return [label for label in labels if label is not None]


def check_label(job: LabelJob, label: GraspLabel) -> GraspLabel | None:
    """Return the label of the same grasp with the accurate physics."""
    return _bench(job, "accurate").label(label.grasp)


@functools.lru_cache(maxsize=2)
def _bench(job: LabelJob, physics: str) -> GraspBench:
    return GraspBench(job.model, job.scale, job.hand, physics)


def label_grasps(
    job: LabelJob, n: int, engine: Engine, tell: Callable[[int], None]
) -> list[GraspLabel]:
    """Return n labelled grasps; the same for any number of processes.

    Args:
        job: The object, hand and physics.
        n: Number of grasps, at least 1.
        engine: Runs the bench; must be entered.
        tell: Receives the number of labels so far.

    Raises:
        ScenarioError: If the hand does not find a grasp from any of 40 directions.
    """
    found: list[GraspLabel] = []
    tasks = _in_order(engine, lambda k: engine.submit(label_direction, job, k))
    for direction, labels in enumerate(tasks):
        found += labels
        tell(min(len(found), n))
        if len(found) >= n:
            break
        if not found and direction + 1 >= _HOPELESS:
            raise ScenarioError(_hopeless(job))
    return found[:n]


def check_labels(
    job: LabelJob,
    labels: Sequence[GraspLabel],
    count: int,
    engine: Engine,
    tell: Callable[[int], None],
) -> list[tuple[GraspLabel, GraspLabel]]:
    """Return `count` evenly spaced labels, each with that of the accurate physics."""
    indices = np.linspace(0, len(labels) - 1, min(count, len(labels))).astype(int)
    chosen = [labels[i] for i in dict.fromkeys(indices.tolist())]

    def submit(k: int) -> Future[GraspLabel | None] | None:
        return engine.submit(check_label, job, chosen[k]) if k < len(chosen) else None

    pairs = []
    for label, checked in zip(chosen, _in_order(engine, submit), strict=True):
        if checked is not None:
            pairs.append((label, checked))
        tell(len(pairs))
    return pairs


def _in_order(
    engine: Engine, submit: Callable[[int], Future[Any] | None]
) -> Iterator[Any]:
    """Yield the results of tasks 0, 1, ... in order, until `submit` returns None."""
    pending: collections.deque[Future[Any]] = collections.deque()
    number, more = 0, True
    while more or pending:
        while more and len(pending) <= engine.slots():
            task = submit(number)
            more, number = task is not None, number + 1
            if task is not None:
                pending.append(task)
        if pending:
            yield pending.popleft().result()


def _hopeless(job: LabelJob) -> str:
    solid, _ = object_pieces(job.name, job.object)
    size = " x ".join(f"{1e3 * side:.0f}" for side in solid.bounding_size)
    most = 1e3 * HANDS[job.hand].fingers.max_width
    return (
        f"{job.name}: no grasp from any of {_HOPELESS} directions: the hand "
        f"{job.hand} grasps objects of at most {most:.0f} mm, this one measures "
        f"{size} mm"
    )


def write_labels(path: Path, job: LabelJob, labels: Sequence[GraspLabel]) -> None:
    """Write labels as YAML or Parquet, by the file's suffix; complete or not at all.

    Raises:
        OSError: If the file cannot be written.
        ImportError: If PyArrow is missing for Parquet.
    """
    content = _parquet if path.suffix == ".parquet" else _yaml
    write_file(path, content(job, labels))


def _row(label: GraspLabel) -> dict[str, Any]:
    """Return a label as plain data, rounded to micrometres."""
    X_OG = label.grasp.X_OG
    return {
        "position": np.round(X_OG.translation(), 6).tolist(),
        "orientation": np.round(X_OG.rotation().ToQuaternion().wxyz(), 6).tolist(),
        "success": label.success,
        "strength": round(label.strength, 4),
        "margin": round(label.margin, 4),
        "epsilon": round(label.epsilon, 5),
        "force_closure": label.force_closure,
        "closure": round(label.closure, 4),
        "opening": round(2.0 * label.grasp.half_gap, 5),
        "width": round(label.grasp.width, 5),
        "score": round(label.grasp.score, 3),
        "shifted": label.grasp.shifted,
        "failure": label.failure,
    }


def _about(job: LabelJob) -> dict[str, Any]:
    import importlib.metadata

    return {
        "created_with": f"drake_srg {importlib.metadata.version('drake_srg')}",
        "object_file": job.model,
        "object_scale": job.scale,
        "object_frame_link": job.name,
        "gripper_file": f"package://drake_srg/sdf/{HANDS[job.hand].fine}.sdf",
        "gripper_frame_link": "palm",
        "physics": job.physics,
        "seed": job.seed,
    }


def _yaml(job: LabelJob, labels: Sequence[GraspLabel]) -> bytes:
    grasps = {}
    for i, label in enumerate(labels):
        row = _row(label)
        w, *xyz = row.pop("orientation")
        grasps[f"grasp_{i}"] = {
            "confidence": 1.0 if row["success"] else 0.0,
            "position": row.pop("position"),
            "orientation": {"w": w, "xyz": xyz},
            "cspace_position": _rounded(label.closed),
            "pregrasp_cspace_position": _rounded(label.opened),
            **row,
        }
    tree = {"format": "isaac_grasp", "format_version": 1.0, **_about(job)}
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # 7 times as fast
    text = yaml.dump(
        {**tree, "grasps": grasps}, Dumper=dumper, sort_keys=False, width=1000
    )
    return str(text).encode()


def _rounded(angles: Mapping[str, float]) -> dict[str, float]:
    return {name: round(angle, 5) for name, angle in angles.items()}


def _parquet(job: LabelJob, labels: Sequence[GraspLabel]) -> bytes:
    pa, parquet = require_sweep("pyarrow"), require_sweep("pyarrow.parquet")
    rows = []
    for label in labels:
        joints = {
            f"{when}_{name}": angle
            for when, angles in (("opened", label.opened), ("closed", label.closed))
            for name, angle in _rounded(angles).items()
        }
        rows.append(_row(label) | joints)
    table = pa.Table.from_pylist(rows)
    table = table.replace_schema_metadata({k: str(v) for k, v in _about(job).items()})
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    return buffer.getvalue()


def best(labels: Sequence[GraspLabel], count: int = 10) -> list[GraspLabel]:
    """Return the strongest grasps; ties go to the larger epsilon."""
    return sorted(labels, key=lambda x: (x.strength, x.epsilon), reverse=True)[:count]


def draw_labels(job: LabelJob, labels: Sequence[GraspLabel]) -> Image:
    """Return a contact sheet of grasps, RGB, shape (height, width, 3).

    Raises:
        ScenarioError: If a model cannot be read.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    AddStudio(scene_graph, _LIGHTS)
    parser = Parser(plant)
    configure_parser(parser)
    file = resolve_url(f"package://drake_srg/sdf/{HANDS[job.hand].fine}.sdf")
    (hand,) = parser.AddModels(str(file))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("palm", hand))
    body = plant.get_body(object_body(plant, AddObject(plant, job.name, job.object)))
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    solid, _ = object_pieces(job.name, job.object)
    middle = np.array([0.5 * _FINGERS_END, 0.0, 0.0])
    most = max(0.5 * _FINGERS_END, 0.5 * float(np.linalg.norm(solid.bounding_size)))
    far = most / np.sin(0.5 * FIELD_OF_VIEW) + most
    X_WC = look_at(middle + far * _EYE / np.linalg.norm(_EYE), middle)
    clipping = ClippingRange(0.05 * far, 10.0 * far)
    pictures = {}
    for i, label in enumerate(labels):
        for name, angle in label.closed.items():
            plant.GetJointByName(name, hand).set_angle(plant_context, angle)
        plant.SetFreeBodyPose(plant_context, body, label.grasp.X_OG.inverse())
        text = f"{i + 1}: {label.strength:.1f} g, epsilon {label.epsilon:.2f}"
        pictures[text] = photograph(scene_graph, context, X_WC, clipping, _PIXELS)
    return contact_sheet(pictures)
