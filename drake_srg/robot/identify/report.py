"""The report of an identification, and the scenario that it makes."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drake_srg.robot.identify.fits import TORQUE_CONSTANT, Identification
from drake_srg.robot.identify.least_squares import Estimate

_TIED = 0.7  # correlations from here on are reported
_UNTELLABLE = (
    "The log cannot tell:",
    "  newtons: nothing in it measures a force. Torques are amperes of the servo's own",
    "  estimate times the data sheet's 1.46 N m/A; if the estimate is off, they are.",
    "  the springs: their torque is far below the motor's.",
    "  the wires' friction on their guides: it changes the pads' force, not the spool.",
    "  the motor's speed: no row measures a motion.",
)


def report(result: Identification) -> Iterator[str]:
    """Yield lines: parameters, correlations, errors, and what the log cannot show."""
    yield f"{'parameter':20} {'value':>10} {'95 % interval':>22}"
    for fit in result.fits.values():
        for e in fit.estimates:
            interval = f"{e.low:.3g} .. {e.high:.3g}"
            note = "" if e.told else "  (mostly assumed)"
            yield (
                f"{e.parameter.name:20} {e.value:10.4g} {interval:>22} "
                f"{e.parameter.unit}{note}"
            )
    tied = list(_correlations(result))
    if tied:
        yield from ("", "Tied to each other (correlation):", *tied)
    yield ""
    yield f"{'test':16} {'quantity':9} {'measured':>9} {'fitted':>9} {'predicted':>9}"
    for error in result.errors:
        flags = [
            "" if abs(value - error.measured) <= error.allowed else word
            for value, word in (
                (error.fitted, "misfit"),
                (error.predicted, "mispredicted"),
            )
        ]
        yield (
            f"{error.label:16} {error.quantity:9} {error.measured:9.4g} "
            f"{error.fitted:9.4g} {error.predicted:9.4g} {error.unit} "
            f"{' '.join(filter(None, flags))}"
        ).rstrip()
    yield "(predicted: by a fit to the other half of the rows)"
    yield ""
    for quantity in ("current", "stop", "heating"):
        fitted, predicted = spread(result, quantity)
        unit = "counts" if quantity == "stop" else "%"
        yield (
            f"{quantity}: off by {fitted:.1f} {unit} (fitted), {predicted:.1f} {unit} "
            "(predicted), root mean square"
        )
    yield ""
    yield from _UNTELLABLE


def spread(result: Identification, quantity: str) -> tuple[float, float]:
    """Return the RMS error, fitted and predicted: in counts for stops, else percent."""
    errors = [error for error in result.errors if error.quantity == quantity]
    scale = np.array(
        [1.0 if quantity == "stop" else e.measured / 100.0 for e in errors]
    )
    measured = np.array([error.measured for error in errors])
    fitted, predicted = (
        float(np.sqrt(np.mean(((np.array(values) - measured) / scale) ** 2)))
        for values in (
            [error.fitted for error in errors],
            [error.predicted for error in errors],
        )
    )
    return fitted, predicted


def _correlations(result: Identification) -> Iterator[str]:
    for fit in result.fits.values():
        names = [e.parameter.name for e in fit.estimates]
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            if abs(fit.correlation[i, j]) >= _TIED:
                yield f"  {names[i]}, {names[j]}: {fit.correlation[i, j]:+.2f}"


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
        "stiction": max(press["stiction"], 1.0),
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
        f"      stiction: {drive['stiction']}{_note(told['stiction'])}",
        "  temperature:",
    ]
    for name in ("stall_current", *_HEAT):
        lines.append(f"    {name}: {told[name].value:.4g}{_note(told[name])}")
    return "\n".join(lines) + "\n"


_HEAT = ("heat_capacity", "thermal_resistance", "idle_power", "winding_time")


def _note(estimate: Estimate, start: str = "  #") -> str:
    """Return an estimate's interval as a comment."""
    told = "" if estimate.told else ", mostly assumed"
    return f"{start} {estimate.low:.3g} .. {estimate.high:.3g}{told}"
