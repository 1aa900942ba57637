"""What an identification says, as text."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from drake_srg.identification.fits import Identification

_TIED = 0.7  # correlations from here on are worth telling
_UNTELLABLE = (
    "The log cannot tell:",
    "  newtons: nothing in it measures a force. Torques are amperes of the servo's own",
    "  estimate times the data sheet's 1.46 N m/A; if the estimate is off, they are.",
    "  the springs: their torque is far below the friction of the gears.",
    "  the wires' friction on their guides: it changes the pads' force, not the spool.",
    "  the motor's speed: no row measures a motion.",
)


def report(result: Identification) -> Iterator[str]:
    """Yield lines: parameters, correlations, errors, and what the log cannot tell."""
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
