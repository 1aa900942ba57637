"""The report of an identification, and a scenario file with its results."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drake_srg.robot.identify.fits import TORQUE_CONSTANT, Identification
from drake_srg.robot.identify.least_squares import Estimate

_TIED = 0.7  # smallest correlation to report
_UNTELLABLE = (
    "The log cannot determine:",
    "  forces: no row measures one. Torques are the servo's estimate of its current",
    "  times the data sheet's 1.46 N m/A, and are as wrong as this estimate.",
    "  the springs: their torque is far below the motor's.",
    "  the wires' friction on their guides: it changes the pads' force, not the spool.",
    "  the motor's speed: no row measures a motion.",
)


def report(result: Identification) -> Iterator[str]:
    """Yield lines: parameters, correlations, errors, and the limits of the log."""
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
    """Return the RMS errors, fitted and predicted [counts for stops, else percent]."""
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
# Fingers and pads between spool and tips deform, too: their stiffness seen at each wire
# [N/m], in `gripper_bench`, with the tips pressed against each other.
FINGER_STIFFNESS = 2.5e6
# Mass of a finger seen at its wire [kg], and damping of wires, relative to critical.
_FINGER_MASS, _DAMPING_RATIO = 1.2, 0.1


def drive_values(result: Identification) -> dict[str, float]:
    """Return the entries of `gripper.drive` that the log identifies, by name."""
    press = result.fits["press"].values
    motor = result.fits["motor"].values
    net = TORQUE_CONSTANT * motor["stall_current"]
    # The spool's rotational stiffness comes from two wires at its radius.
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
        result: The result of `identify`.
        base: Name of a scenario whose gripper has wires, or its path relative to the
            file.
        source: What was identified, for the file's first line.
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
