"""The command `drake-srg grasps`."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import SUCCESS, argument, command, writing
from drake_srg.cli.results import REPLACE
from drake_srg.cli.sweep import ENGINE, make_engine
from drake_srg.common.exceptions import ScenarioError, scenario_errors, suggest
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.learning.grasp_bench import GraspLabel
    from drake_srg.learning.grasp_labels import LabelJob

# Agreement with the accurate physics is also printed for larger margins than this [g].
_MARGIN = 0.4


@command(
    "label grasps of an object: sampled, planned and shaken",
    "A grasp succeeds if the object stays in the hand at 1 g. The labels go to an "
    "Isaac grasp file, the format of GraspGen, or to a Parquet file.",
    argument(
        "model",
        metavar="MODEL",
        help="a name from `drake-srg list --objects`, or an .sdf, .urdf, .obj, .stl, "
        ".glb or .gltf",
    ),
    argument(
        "--hand",
        choices=("srg", "linkage"),
        default="srg",
        metavar="NAME",
        help="the hand: srg or linkage (default: %(default)s)",
    ),
    argument(
        "--n",
        type=int,
        default=100,
        metavar="N",
        help="number of grasps (default: %(default)s)",
    ),
    argument(
        *("-o", "--out"),
        type=Path,
        metavar="FILE",
        help="a .yaml or a .parquet; a .png beside it shows the best ten grasps "
        "(default: out/grasps/NAME_HAND.yaml)",
    ),
    REPLACE,
    argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="seed of the samples (default: %(default)s)",
    ),
    argument(
        "--scale",
        type=float,
        default=1.0,
        metavar="X",
        help="metres per unit of a mesh: 0.001 for millimetres",
    ),
    argument(
        "--physics",
        choices=("train", "fast", "accurate"),
        default="train",
        metavar="NAME",
        help="the physics of the learning environments: train, fast or accurate "
        "(default: %(default)s)",
    ),
    argument(
        "--check",
        type=int,
        default=0,
        metavar="N",
        help="repeat N of the grasps with the accurate physics and print the agreement",
    ),
    ENGINE,
)
@scenario_errors()
def grasps(options: argparse.Namespace) -> int:
    """Label grasps of an object, write them, and print how many hold."""
    job = _job(options)
    out, picture = _files(options, job)
    if options.n < 1:
        raise ScenarioError(f"--n {options.n}: must be at least 1")
    if options.check < 0:
        raise ScenarioError(f"--check {options.check}: must be at least 0")
    if options.seed < 0:
        raise ScenarioError(f"--seed {options.seed}: must be at least 0")
    engine = make_engine(options)
    import cv2

    from drake_srg.learning.grasp_labels import (
        best,
        check_labels,
        draw_labels,
        label_grasps,
        write_labels,
    )
    from drake_srg.sweeps.files import write_file

    start = time.perf_counter()
    with engine, StatusLine(shown=options.console.progress) as line:

        def tell(count: int, of: int, what: str) -> None:
            line.show(f"{job.name}: {count} of {of} {what}")

        labels = label_grasps(
            job, options.n, engine, lambda k: tell(k, options.n, "grasps labelled")
        )
        seconds = time.perf_counter() - start
        pairs = []
        if options.check:
            pairs = check_labels(
                job,
                labels,
                options.check,
                engine,
                lambda k: tell(k, options.check, "grasps checked"),
            )
    with writing("--out", out):
        write_labels(out, job, labels)
    with writing("--out", picture):
        sheet = draw_labels(job, best(labels))
        write_file(picture, cv2.imencode(".png", sheet[:, :, ::-1])[1].tobytes())
    held = sum(label.success for label in labels)
    rate = 3600.0 * len(labels) / seconds
    options.console.say(
        f"{len(labels)} grasps, {held} hold, {rate:,.0f} an hour",
        *_agreement(pairs),
        "",
        out,
        picture,
    )
    options.console.answer(
        {
            "grasps": len(labels),
            "held": held,
            "per_hour": rate,
            "checked": len(pairs),
            "agree": sum(a.success == b.success for a, b in pairs),
            "files": [out, picture],
        }
    )
    return SUCCESS


def _job(options: argparse.Namespace) -> LabelJob:
    """Return the labelling task; check that the model exists."""
    from drake_srg.learning.grasp_labels import LabelJob
    from drake_srg.objects.household import HOUSEHOLD, household_object
    from drake_srg.objects.meshes.load import resolve

    if not 0.0 < options.scale < float("inf"):
        raise ScenarioError(f"--scale {options.scale}: must be greater than 0")
    name = options.model
    if name in HOUSEHOLD:
        model = str(household_object(name).model)
    else:
        if not Path(name).suffix and "/" not in name:
            raise ScenarioError(
                f"MODEL: unknown object {name!r} {suggest(name, HOUSEHOLD)}"
            )
        file = resolve(name)
        if not file.is_file():
            raise ScenarioError(f"{file}: cannot be read: no such file")
        model, name = str(file), file.stem
    return LabelJob(
        name=name,
        model=model,
        scale=options.scale,
        hand=options.hand,
        physics=options.physics,
        seed=options.seed,
    )


def _files(options: argparse.Namespace, job: LabelJob) -> tuple[Path, Path]:
    """Return the paths of labels and picture, which may be written.

    Raises:
        ScenarioError: If a suffix is unknown, a folder is missing, or a file exists.
    """
    from drake_srg.learning.grasp_labels import SUFFIXES

    default = Path("out") / "grasps" / f"{job.name}_{job.hand}.yaml"
    out: Path = options.out or default
    picture = out.with_suffix(".png")
    if out.suffix not in SUFFIXES:
        raise ScenarioError(f"--out {out}: must end in {' or '.join(SUFFIXES)}")
    if out.parent != default.parent and not out.parent.is_dir():
        raise ScenarioError(f"--out {out}: the folder {out.parent} is missing")
    for path in (out, picture):
        if path.exists() and not options.replace:
            raise ScenarioError(
                f"--out {path}: already exists; choose another, or add --replace"
            )
    return out, picture


def _agreement(pairs: list[tuple[GraspLabel, GraspLabel]]) -> list[str]:
    """Return a line on how many labels agree with the accurate physics."""
    if not pairs:
        return []
    clear = [(a, b) for a, b in pairs if abs(a.margin) > _MARGIN]
    counts = [sum(a.success == b.success for a, b in some) for some in (pairs, clear)]
    return [
        f"agree with the accurate physics: {counts[0]} of {len(pairs)}; with margins "
        f"beyond {_MARGIN} g: {counts[1]} of {len(clear)}"
    ]
