"""The command export."""

from __future__ import annotations

import argparse
from pathlib import Path

from drake_srg.cli.command import SCENARIO, argument, command, load, one_of
from drake_srg.cli.process import SUCCESS, writing

_PROGRAMS = {
    "urdf": "ROS, Drake and most other tools",
    "mjcf": "MuJoCo; the SRG's wires are tendons",
    "sdf": "Gazebo and Drake",
}


@command(
    "write a scenario's models as URDF, MJCF or SDF",
    "One file per model, and `scene` with all of them in their places.",
    SCENARIO,
    one_of(
        *(
            argument(
                f"--{kind}",
                type=Path,
                metavar="DIR",
                help=f"folder for {kind.upper()} files: {programs}",
            )
            for kind, programs in _PROGRAMS.items()
        ),
        required=True,
    ),
)
def export(options: argparse.Namespace) -> int:
    """Write a scenario's models in a format, and print their paths."""
    from drake_srg.export import export_scenario
    from drake_srg.export.wires import moment_arm_error

    scenario = load(options)
    kind = next(k for k in _PROGRAMS if getattr(options, k) is not None)
    out: Path = getattr(options, kind)
    with writing(f"--{kind}", out):
        exported = export_scenario(scenario, kind, out)
    for each in exported:
        options.console.say(each.path)
    errors = [moment_arm_error(each.wires) for each in exported if each.wires]
    if errors:
        options.console.say(
            "",
            f"Moment arms of the tendons: within {max(errors):.2%} of the wires'.",
        )
    options.console.answer(
        {
            "models": {each.model.name: each.path for each in exported},
            "moment_arm_error": max(errors, default=None),
        }
    )
    return SUCCESS
