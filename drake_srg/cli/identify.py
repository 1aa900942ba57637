"""The command `drake-srg identify`."""

import argparse
import dataclasses as dc
import os
from pathlib import Path

from drake_srg.cli.command import argument, command
from drake_srg.cli.process import SUCCESS, writing
from drake_srg.common.exceptions import ScenarioError

VENDOR = "vendor"


@command(
    "fit a gripper's motor, friction and heat to what its servo showed",
    "It prints intervals, correlations and what the log leaves open, and writes a "
    "scenario.",
    argument(
        "log",
        metavar="LOG.csv",
        help=f"rows of your gripper's tests, or `{VENDOR}` for the maker's own "
        "(columns: docs/gripper.md)",
    ),
    argument(
        *("-o", "--output"),
        type=Path,
        metavar="FILE.yaml",
        default=Path("srg_specimen.yaml"),
        help="the scenario to write (default: %(default)s)",
    ),
    argument(
        "--base",
        default="gripper_bench",
        metavar="SCENARIO",
        help="scenario whose gripper is replaced (default: %(default)s)",
    ),
)
def identify(options: argparse.Namespace) -> int:
    """Fit a gripper's parameters to its log and write a scenario with them.

    Raises:
        ScenarioError: If the log or the base is invalid, or writing fails.
    """
    from drake_srg.gripper.drivers import SrgTendonDriver
    from drake_srg.identification.fits import identify as fit_log
    from drake_srg.identification.log import read_log, vendor_log
    from drake_srg.identification.overlay import overlay
    from drake_srg.identification.report import report
    from drake_srg.scenario import load_scenario
    from drake_srg.scenario.yaml_tree import parse_yaml
    from drake_srg.scenario.yaml_typed import check_tree
    from drake_srg.sweeps.files import write_file

    gripper = load_scenario(options.base).gripper
    if gripper is None or gripper.wire_motor is None:
        raise ScenarioError(f"--base {options.base}: gripper: needs !SrgTendonDriver")
    base = options.base
    if base.endswith(".yaml"):
        if Path(base).resolve() == options.output.resolve():
            raise ScenarioError(f"-o {options.output}: must differ from --base")
        # A scenario names its base relative to its own folder.
        base = os.path.relpath(base, options.output.parent)
    own = options.log != VENDOR
    rows = read_log(Path(options.log)) if own else vendor_log()
    result = fit_log(rows)
    source = Path(options.log).stem if own else "an EZGripper measured by its vendor"
    text = overlay(result, base, source)
    # A log of something else may give values that no scenario takes.
    tree = parse_yaml(text, options.log)["gripper"]
    check_tree(tree, SrgTendonDriver | None, options.log, "gripper")
    with writing("-o", options.output):
        write_file(options.output, text.encode("utf-8"))
    options.console.say(*report(result), "", options.output)
    options.console.answer(
        {
            "parameters": {
                e.parameter.name: {
                    "value": e.value,
                    "interval": [e.low, e.high],
                    "unit": e.parameter.unit,
                    "told": e.told,
                }
                for fit in result.fits.values()
                for e in fit.estimates
            },
            "errors": [dc.asdict(error) for error in result.errors],
            "scenario": options.output,
        }
    )
    return SUCCESS
