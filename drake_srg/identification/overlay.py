"""The scenario that an identified gripper makes of another one."""

from __future__ import annotations

import math

from drake_srg.identification.fits import Identification
from drake_srg.identification.least_squares import Estimate
from drake_srg.identification.press import TORQUE_CONSTANT

SPOOL_RADIUS = 0.0076  # m, see TendonDriveConfig
# Between spool and tips, fingers and pads give as well: seen at each wire [N/m], in
# `gripper_bench`, tip on tip.
FINGER_STIFFNESS = 2.5e6
# Mass of a finger seen from its wire [kg]; wires damp a tenth of critically.
_FINGER_MASS, _DAMPING_RATIO = 1.2, 0.1


def drive_values(result: Identification) -> dict[str, float]:
    """Return the entries of `gripper.drive` that the log identifies, by name."""
    press = result.fits["press"].values
    motor = result.fits["motor"].values
    net = TORQUE_CONSTANT * motor["stall_current"]
    # Each of the two wires sees the spool's stiffness through its radius.
    whole = press["stiffness"] / (2.0 * SPOOL_RADIUS**2)
    wire = 1.0 / max(1.0 / whole - 1.0 / FINGER_STIFFNESS, 1e-7)
    return {
        "stall_torque": net * (1.0 + press["gear_load"]) + press["gear"],
        "dead_band": motor["dead_band"],
        "torque_rise": press["torque_rise"],
        "reflected_inertia": press["inertia"],
        "wire_stiffness": wire,
        "wire_damping": 2.0 * _DAMPING_RATIO * math.sqrt(wire * _FINGER_MASS),
        "gear": press["gear"],
        "gear_load": press["gear_load"],
    }


def overlay(result: Identification, base: str, source: str) -> str:
    """Return a scenario file: `base` with the identified gripper.

    Args:
        result: Of `identify`.
        base: A scenario whose gripper has wires: its name, or its path from the file.
        source: What was identified, for the first line.
    """
    told = {e.parameter.name: e for fit in result.fits.values() for e in fit.estimates}
    drive = {name: f"{value:.4g}" for name, value in drive_values(result).items()}
    lines = [
        f"# {base} with the motor, friction and heat of {source}.",
        "# Written by `drake-srg identify`; 95 % intervals behind the values.",
        f"base: {base}",
        "",
        "gripper: !SrgTendonDriver",
        "  drive:",
        "    # The data sheet's torque per ampere, times the estimated stall current,",
        "    # before the friction of the gears.",
        f"    stall_torque: {drive['stall_torque']}",
        f"    dead_band: {drive['dead_band']}{_note(told['dead_band'])}",
        f"    torque_rise: {drive['torque_rise']}{_note(told['torque_rise'])}",
        f"    reflected_inertia: {drive['reflected_inertia']}{_note(told['inertia'])}",
        f"    # From {told['stiffness'].value:.3g} N m/rad at the spool"
        f"{_note(told['stiffness'], ',')}",
        f"    wire_stiffness: {drive['wire_stiffness']}",
        f"    wire_damping: {drive['wire_damping']}",
        "    friction:",
        f"      gear: {drive['gear']}{_note(told['gear'])}",
        f"      gear_load: {drive['gear_load']}{_note(told['gear_load'])}",
        "  temperature:",
    ]
    for name in ("stall_current", *_HEAT):
        lines.append(f"    {name}: {told[name].value:.4g}{_note(told[name])}")
    return "\n".join(lines) + "\n"


_HEAT = ("heat_capacity", "thermal_resistance", "idle_power")


def _note(estimate: Estimate, start: str = "  #") -> str:
    """Return an estimate's interval as a comment."""
    told = "" if estimate.told else ", mostly assumed"
    return f"{start} {estimate.low:.3g} .. {estimate.high:.3g}{told}"
