"""The commands `drake-srg import` and `drake-srg list --objects`."""

from __future__ import annotations

import argparse
import dataclasses as dc
import json
import re
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TYPE_CHECKING

from drake_srg.cli.command import (
    SUCCESS,
    TASK_FAILED,
    argument,
    command,
    one_of,
    writing,
)
from drake_srg.cli.results import folder, new_folder, results_folder
from drake_srg.common.exceptions import ScenarioError, scenario_errors
from drake_srg.common.status_line import StatusLine

if TYPE_CHECKING:
    from drake_srg.objects.meshes.convert import Report
    from drake_srg.simulation.rig import DropOutcome

_PICTURE = "picture.png"
_FILES = (*("model.sdf", "import.json"), *("*.obj", "*.mtl", "*.png", "*.jpg"))
_SHEET = "objects.png"
_PIXELS = 320


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be greater than 0, got {text}")
    return value


def _color(text: str) -> list[float]:
    values = [float(word) for word in text.split(",")]
    if len(values) != 3 or not all(0.0 <= value <= 1.0 for value in values):
        raise argparse.ArgumentTypeError(f"needs R,G,B, each 0 .. 1, got {text}")
    return values


@command(
    "make a model of an object from a mesh, a URDF or an SDF file",
    "It repairs the file, cuts meshes into convex pieces, draws the object and drops "
    "it on a table. Exit code: 0 the object rests there, 1 it does not, 2 bad input.",
    argument(
        "file",
        type=Path,
        metavar="FILE",
        help="an .sdf, .urdf, .obj, .stl, .glb or .gltf",
    ),
    folder("the model", "out/objects/NAME"),
    one_of(
        argument(
            "--mass",
            type=_positive,
            metavar="KG",
            help="the mass",
        ),
        argument(
            "--density",
            type=_positive,
            metavar="X",
            help="the density [kg/m3], in place of the mass",
        ),
    ),
    argument("--friction", type=_positive, metavar="MU", help="friction coefficient"),
    argument(
        "--color",
        type=_color,
        metavar="COLOR",
        help="the colour of the whole object: R,G,B, each 0 .. 1",
    ),
    argument(
        "--scale",
        type=_positive,
        default=1.0,
        metavar="X",
        help="metres per unit of a mesh: 0.001 for millimetres",
    ),
    argument(
        "--pieces",
        type=int,
        default=32,
        metavar="N",
        help="largest number of convex pieces per mesh (default: 32)",
    ),
    name="import",
)
@scenario_errors()
def import_object(options: argparse.Namespace) -> int:
    """Make a checked SDF from a file; print the repairs, and whether it rests."""
    from drake_srg.objects.meshes.convert import MODEL, read_report
    from drake_srg.objects.meshes.load import copy_folder, import_model, resolve

    file = resolve(str(options.file))
    name = re.sub(r"\W+", "_", file.stem)
    if not 1 <= options.pieces <= 256:
        raise ScenarioError(f"--pieces: must be 1 .. 256, got {options.pieces}")
    with new_folder(options, Path("out") / "objects" / name, _FILES) as out:
        with StatusLine(shown=options.console.progress) as line:
            line.show(f"{name}: repairing the file and cutting convex pieces")
            folder = import_model(file, options.scale, options.pieces, quiet=True)
        report = read_report(folder)
        with writing("--out", out):
            out.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".", dir=out.parent) as there:
                new = Path(there) / name
                copy_folder(folder, new)
                report = _adjust(new, name, report, options)
                with StatusLine(shown=options.console.progress) as line:
                    line.show(f"{name}: drawing and dropping the object")
                    outcome = _draw_and_drop(new / MODEL, name)
                new.rename(out)
    files = [out / MODEL, out / _PICTURE]
    options.console.say(*_description(report, outcome), "", *files)
    options.console.answer(dc.asdict(report) | {"rests": outcome.rests, "files": files})
    return SUCCESS if outcome.rests else TASK_FAILED


def _adjust(
    folder: Path, name: str, report: Report, options: argparse.Namespace
) -> Report:
    """Apply name, mass, friction and colour to a model; return the new report."""
    from drake_srg.objects.meshes.convert import MODEL, REPORT
    from drake_srg.objects.sdf import SetColor, SetContact, SetMass

    tree = ET.parse(folder / MODEL)
    root = tree.getroot()
    for element in (root.find("model"), root.find("model/link")):
        assert element is not None
        element.set("name", name)
    mass = options.mass
    if options.density is not None:
        mass = options.density * report.volume
    if mass is not None:
        SetMass(root, mass)
        kept = [text for text in report.warnings if not text.startswith("no mass")]
        report = dc.replace(report, mass=mass, warnings=kept)
    friction = options.friction
    SetContact(root, {"mu_static": friction, "mu_dynamic": friction})
    if options.color is not None:
        SetColor(root, options.color)
    ET.indent(root, "  ")
    tree.write(folder / MODEL, encoding="unicode")
    text = json.dumps(dc.asdict(report), indent=2)
    (folder / REPORT).write_text(text + "\n", encoding="utf-8")
    return report


def _draw_and_drop(model: Path, name: str) -> DropOutcome:
    """Draw an imported model, and return the outcome of its drop on a table."""
    import cv2

    from drake_srg.objects.config import ObjectConfig
    from drake_srg.objects.household import take_portrait
    from drake_srg.simulation.rig import drop

    config = ObjectConfig(model=str(model))
    portrait = take_portrait(name, config, _PIXELS)
    cv2.imwrite(str(model.with_name(_PICTURE)), portrait[:, :, ::-1])
    return drop(config)


def _description(report: Report, outcome: DropOutcome) -> list[str]:
    """Return repairs and measurements, one per line."""
    size = " x ".join(f"{1e3 * side:.1f}" for side in report.size)
    cut = " cut by CoACD" if report.cut else ""
    count = f"{report.pieces} piece" + "s" * (report.pieces != 1)
    fit = [f"{1e3 * value:.1f} mm" for value in (report.excess, report.gap)]
    return [
        *(f"warning: {warning}" for warning in report.warnings),
        f"{'size':10} {size} mm",
        f"{'mass':10} {report.mass:.4g} kg",
        f"{'contact':10} {count}{cut}",
        f"{'fit':10} pieces exceed the mesh by up to {fit[0]}, the mesh the pieces by "
        f"{fit[1]}",
        f"{'drop test':10} {outcome}",
    ]


def list_objects(options: argparse.Namespace) -> int:
    """Print name, size, mass and pieces of the household objects; draw them with -o."""
    from drake_srg.objects.household import HOUSEHOLD, household_object, object_facts

    say, found = options.console.say, {}
    say(f"{'object':26} {'size [mm]':>18} {'mass [g]':>9} {'pieces':>7}")
    for name in HOUSEHOLD:
        facts = object_facts(name, household_object(name))
        found[name] = {
            "size_m": [float(side) for side in facts.size],
            "mass_kg": facts.mass,
        }
        size = " x ".join(f"{1e3 * side:.0f}" for side in facts.size)
        say(f"{name:26} {size:>18} {1e3 * facts.mass:>9.4g} {facts.pieces:>7}")
    pictures: list[Path] = []
    if options.out is not None:
        names = [f"{name}.png" for name in HOUSEHOLD]
        with results_folder(options, options.out, names) as out:
            pictures = _draw_all(out)
        say("", *pictures)
    options.console.answer({"objects": found, "pictures": pictures})
    return SUCCESS


def _draw_all(folder: Path) -> list[Path]:
    """Draw each household object, and a sheet of all; return the files."""
    import cv2

    from drake_srg.objects.household import (
        HOUSEHOLD,
        contact_sheet,
        household_object,
        take_portrait,
    )

    folder.mkdir(parents=True, exist_ok=True)
    pictures = {
        name: take_portrait(name, household_object(name), _PIXELS) for name in HOUSEHOLD
    }
    files = {f"{name}.png": picture for name, picture in pictures.items()}
    files[_SHEET] = contact_sheet(pictures)
    for name, picture in files.items():
        _, png = cv2.imencode(".png", picture[:, :, ::-1])
        (folder / name).write_bytes(png.tobytes())
    return [folder / name for name in files]
