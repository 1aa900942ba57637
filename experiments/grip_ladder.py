"""From a command to a grip: counts, wire, current, wire force, pad force and payload.

The hand closes on boxes of 20, 68 and 140 mm with rising effort, each time from the
open hand. docs/gripper.md shows the resulting table and figure.
"""

import numpy as np

import experiments.runner as ex
from drake_srg.common.srg_geometry import SRG
from drake_srg.gripper.srg_tendon_driver import SpoolCommandConfig, spool_angle
from drake_srg.gripper.tendon import motor_load
from drake_srg.simulation.rig import Rig, bench_scenario
from experiments.grasp_width import HEIGHT, box

_COUNTS = 4096 / (2.0 * np.pi)  # per rad
_RANGE = 2500  # counts from closed to open, 100 % of SAKE's driver
_REGISTER = 800  # torque limit of 100 % effort, see TendonDriveConfig.full_scale
_FRICTION, _GRAVITY = 0.8, 9.81  # of painted metal on rubber; m/s²
_SETTLE = 2.5  # s
# Of the boxes [m], and shares of the range of SAKE's driver.
WIDTHS, EFFORTS = (0.02, 0.068, 0.14), (0.2, 0.35, 0.5, 0.65, 0.8, 1.0)
# Wide boxes are gripped near the palm, the others between the middles of the pads.
_WIDE = 0.1  # m
# ex.Measures of a trial as columns of the table, and their digits.
COLUMNS = {
    "width [mm]": 0,
    "effort [%]": 0,
    "torque limit": 0,
    "closed [%]": 0,
    "SAKE [%]": 0,
    "counts": 0,
    "wire [mm]": 1,
    "current [mA]": 0,
    "wire force [N]": 0,
    "finger force [N]": 1,
    "payload by friction [kg]": 1,
}


def cases(scenario: str = "srg_specimen") -> list[ex.Case]:
    """Grip every box with every effort.

    Args:
        scenario: A bench whose gripper has wires.
    """
    return [
        {"name": f"{1e3 * c['width']:.0f} mm, {100 * c['effort']:.0f} %", **c}
        for c in ex.grid(width=WIDTHS, effort=EFFORTS, scenario=[scenario])
    ]


def trial(name: str, width: float, effort: float, scenario: str) -> ex.Measures:
    thing = box(width)
    height = thing.z if width > _WIDE else 0.7 * HEIGHT + SRG.grasp_center_x
    bench = bench_scenario(thing.config, home=[0.0, 0.0, height], scenario=scenario)
    motor = bench.gripper.wire_motor
    assert motor is not None, f"{scenario}: gripper: needs !SrgTendonDriver"
    radius, config = motor.drive.spool_radius, SpoolCommandConfig()
    with Rig(bench, name="grip_ladder") as rig:
        rig.advance(_SETTLE, closure=1.0, force_limit=effort)
        angle, speed = map(float, rig.measured("gripper.motor_state"))
        load = motor_load(motor.drive, float(rig.measured("gripper.pwm")[0]), speed)
        wires = np.mean(rig.measured("gripper.wire_force"))
        pads = 0.5 * np.sum(rig.measured("gripper.contact_force"))
    closures = np.linspace(0.0, 1.0, 501)
    angles = [spool_angle(c, radius, config) for c in closures]
    values = (
        *(1e3 * width, 100 * effort, round(effort * _REGISTER)),
        100 * np.interp(angle, angles, closures),
        *(100 * (1 - angle * _COUNTS / _RANGE), angle * _COUNTS, 1e3 * radius * angle),
        *(1e3 * load * motor.temperature.stall_current, wires, pads),
        2.0 * _FRICTION * pads / _GRAVITY,
    )
    table = dict(zip(COLUMNS, values, strict=True))
    return {"wire force [N]": wires, "pad force [N]": pads, "table": table}


def ladder(trials: ex.Trials) -> dict[str, str]:
    """Return the table as in docs/gripper.md."""
    lines = [list(COLUMNS), ["---:"] * len(COLUMNS)]
    lines += [
        [f"{t['table'][name]:.{n}f}" for name, n in COLUMNS.items()] for t in trials
    ]
    return {"ladder.md": "".join(f"| {' | '.join(line)} |\n" for line in lines)}


grip_ladder = ex.Experiment(
    "From a command to a grip: counts, wire, current, wire force, pad force, payload.",
    cases,
    trial,
    picture=[
        ex.Points("effort", measure, label=["width [m]"])
        for measure in ("wire force [N]", "pad force [N]")
    ],
    files=ladder,
)
