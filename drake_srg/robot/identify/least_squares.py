"""Least squares with prior knowledge."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from drake_srg.types import Vector

_STEP = 2e-3  # of the logarithm of a parameter, for derivatives
_Z95 = 1.96
_TRIED = 6  # starts from which a minimum is sought


@dc.dataclass(frozen=True)
class Parameter:
    """A positive parameter and what is known of it without measurements.

    Attributes:
        prior: Most likely value.
        factor: By which it may well be off either way (one standard deviation).
    """

    name: str
    unit: str
    prior: float
    factor: float


@dc.dataclass(frozen=True)
class Estimate:
    """A parameter after the measurements.

    Attributes:
        value: Its most likely value.
        low: Lower end of the 95 % interval.
        told: Whether the measurements at least halved what was open.
    """

    parameter: Parameter
    value: float
    low: float
    high: float
    told: bool


@dc.dataclass(frozen=True)
class Fit:
    """The result of `fit`.

    Attributes:
        estimates: In the order of the parameters.
        correlation: Of their logarithms, shape (n, n).
    """

    estimates: Sequence[Estimate]
    correlation: Vector

    @property
    def values(self) -> dict[str, float]:
        """The most likely values by name."""
        return {e.parameter.name: e.value for e in self.estimates}


def fit(
    parameters: Sequence[Parameter],
    residuals: Callable[[dict[str, Vector]], Vector],
    starts: Sequence[Mapping[str, float]] = ({},),
) -> Fit:
    """Fit positive parameters.

    Minimises the squares of residuals and of what the parameters' logarithms are off
    from their priors, in standard deviations each. If the residuals are larger than
    their standard deviations say, the intervals grow by as much.

    Args:
        parameters: At least one.
        residuals: Returns the residuals in standard deviations, shape (p, m), finite,
            for p values of every parameter, by name, shape (p, 1).
        starts: Where to look for a minimum: values by name, priors where they lack one.
            The search begins at the few that fit best.
    """
    prior = np.log([p.prior for p in parameters])
    spread = np.log([p.factor for p in parameters])

    def both(x: Vector) -> Vector:
        """Return residuals and deviations from the priors, (p, m + n) for (p, n)."""
        values = {
            q.name: v[:, None] for q, v in zip(parameters, np.exp(x).T, strict=True)
        }
        measured = residuals(values)
        measured = np.broadcast_to(measured, (len(x), measured.shape[-1]))
        return np.concatenate([measured, (x - prior) / spread], axis=1)

    places = np.log([[s.get(p.name, p.prior) for p in parameters] for s in starts])
    nearest = np.argsort(np.sum(both(places) ** 2, axis=1))[:_TRIED]
    found = min(
        (
            least_squares(
                lambda x: both(x[None])[0],
                place,
                lambda x: _jacobian(both, x),
                method="lm",
            )
            for place in places[nearest]
        ),
        key=lambda found: found.cost,
    )
    x, r, jacobian = found.x, found.fun, found.jac
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    measured = r[: -len(x)]
    freedom = max(len(measured) - len(x), 1)
    inflation = max(1.0, float(measured @ measured) / freedom)
    deviation = np.sqrt(np.diag(covariance))
    wide = np.minimum(deviation * np.sqrt(inflation), spread)
    estimates = [
        Estimate(
            p,
            float(np.exp(value)),
            float(np.exp(value - _Z95 * d)),
            float(np.exp(value + _Z95 * d)),
            bool(d < 0.5 * s),
        )
        for p, value, d, s in zip(parameters, x, wide, spread, strict=True)
    ]
    return Fit(estimates, covariance / np.outer(deviation, deviation))


def _jacobian(function: Callable[[Vector], Vector], x: Vector) -> Vector:
    """Return the derivatives of m values by (n,) arguments, shape (m, n)."""
    middle, *values = function(x + _STEP * np.eye(len(x) + 1, len(x), -1))
    result: Vector = ((np.array(values) - middle) / _STEP).T
    return result
