"""Least squares with priors for the parameters."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from drake_srg.types import Vector

_STEP = 2e-3  # of a parameter's logarithm, for finite differences
_Z95 = 1.96
_TRIED = 6  # number of starts from which to search for a minimum


@dc.dataclass(frozen=True)
class Parameter:
    """A positive parameter with its prior.

    Attributes:
        prior: Most likely value.
        factor: Standard deviation of the prior, as a factor in either direction.
    """

    name: str
    unit: str
    prior: float
    factor: float


@dc.dataclass(frozen=True)
class Estimate:
    """A parameter, estimated from measurements and prior.

    Attributes:
        value: The most likely value.
        low: Lower end of the 95 % interval.
        high: Upper end of the 95 % interval.
        told: Whether the measurements at least halved the prior's uncertainty.
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
        estimates: Estimates, in the order of the parameters.
        correlation: Correlations of the parameters' logarithms, shape (n, n).
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
    """Fit positive parameters to measurements and priors.

    Minimizes the sum of squares of the residuals, and of the deviations of the
    parameters' logarithms from their priors, all in standard deviations. If the
    residuals are larger than expected, the intervals grow by the same factor.

    Args:
        parameters: At least one parameter.
        residuals: Called with p values of every parameter, by name, shape (p, 1).
            Returns finite residuals in standard deviations, shape (p, m).
        starts: Candidates where to start the search: values by name; priors for those
            that are missing. The search starts at the few that fit best.
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
