"""A judged row of an experiment: a quantity, its criterion and its spread."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Mapping
from typing import Any, Literal

# What the machine's speed does to a value: nothing, or it grows with a slower machine
# (a time), or it shrinks (a rate, such as a real-time factor).
Clock = Literal["", "time", "rate"]

# Default spreads as shares: of a value or its criterion, and of a wall-clock value.
_SHARE, _CLOCK_SHARE = 0.1, 0.5
# Units suit the values, so that a millionth of one is round-off [any unit].
_ROUND_OFF = 1e-6


@dc.dataclass(frozen=True)
class Row:
    """A measured quantity and its criterion.

    Make rows with the class methods, which compute `passed`. A measurement passes only
    if it is finite.

    Contact amplifies the last bits of a number, in which versions of Drake and
    processors differ. `spread` says how far the value may move for such reasons. By
    default, it is a tenth of the value or of its limit, whichever is larger, because a
    change far below a limit means nothing; for `within`, it is at most the allowed
    deviation; for a wall-clock value, it is at least half of the value.

    A row that is known not to meet its criterion says why (`known`). It still has not
    passed, and its value is watched like any other, but the experiment does not fail.

    Attributes:
        name: The object, driver or setting that was measured.
        quantity: The measured quantity.
        expected: The criterion as text, such as `<= 3`.
        measured: The measured value.
        unit: Of the value, of the criterion and of the spread.
        passed: Whether the value meets the criterion.
        spread: How far the value may move from one run to another before somebody must
            look into it.
        clock: How the value depends on the machine's speed. The ratio of two times of
            one run does not depend on it.
        known: Why the row does not meet its criterion, where that is known.
    """

    name: str
    quantity: str
    expected: str
    measured: float
    unit: str
    passed: bool
    spread: float
    clock: Clock = ""
    known: str = ""

    @property
    def fails(self) -> bool:
        """Whether the row misses its criterion for no known reason."""
        return not (self.passed or self.known)

    @classmethod
    def at_most(
        cls,
        name: str,
        quantity: str,
        limit: float,
        measured: float,
        unit: str,
        *,
        spread: float | None = None,
        clock: Clock = "",
    ) -> Row:
        """Return a row that expects no more than `limit`."""
        if spread is None:
            spread = _default_spread(clock, measured, limit)
        text, passed = f"<= {limit:.4g}", measured <= limit
        return cls._judged(name, quantity, text, measured, unit, passed, spread, clock)

    @classmethod
    def at_least(
        cls,
        name: str,
        quantity: str,
        limit: float,
        measured: float,
        unit: str,
        *,
        spread: float | None = None,
        clock: Clock = "",
    ) -> Row:
        """Return a row that expects no less than `limit`."""
        if spread is None:
            spread = _default_spread(clock, measured, limit)
        text, passed = f">= {limit:.4g}", measured >= limit
        return cls._judged(name, quantity, text, measured, unit, passed, spread, clock)

    @classmethod
    def within(
        cls,
        name: str,
        quantity: str,
        expected: float,
        measured: float,
        unit: str,
        *,
        relative: float = 0.0,
        absolute: float = 0.0,
        spread: float | None = None,
    ) -> Row:
        """Return a row that expects a value up to a relative or absolute deviation.

        If both deviations are given, the larger one counts.
        """
        allowed = max(relative * abs(expected), absolute)
        if spread is None:
            spread = allowed
            if expected != 0.0:
                spread = min(allowed, _default_spread("", measured, expected))
        text = f"{expected:.4g} +- {allowed:.2g}"
        passed = abs(measured - expected) <= allowed
        return cls._judged(name, quantity, text, measured, unit, passed, spread)

    @classmethod
    def info(
        cls,
        name: str,
        quantity: str,
        measured: float,
        unit: str,
        *,
        spread: float | None = None,
        clock: Clock = "",
    ) -> Row:
        """Return an informative row, which passes with any finite number."""
        if spread is None:
            spread = _default_spread(clock, measured)
        text = "a number"
        return cls._judged(name, quantity, text, measured, unit, True, spread, clock)

    @classmethod
    def _judged(
        cls,
        name: str,
        quantity: str,
        expected: str,
        measured: float,
        unit: str,
        passed: bool,
        spread: float,
        clock: Clock = "",
    ) -> Row:
        passed = bool(passed) and math.isfinite(measured)
        spread = max(float(spread), _ROUND_OFF)
        value = float(measured)
        return cls(name, quantity, expected, value, unit, passed, spread, clock)

    def because(self, reason: str) -> Row:
        """Return the row with a known reason, if it misses its criterion."""
        return self if self.passed else dc.replace(self, known=reason)

    def as_dict(self) -> dict[str, str | float | bool | None]:
        """Return the row as in result.json; values that are not finite become None."""
        values: dict[str, str | float | bool | None] = {
            "name": self.name,
            "quantity": self.quantity,
            "expected": self.expected,
            "measured": self.measured if math.isfinite(self.measured) else None,
            "unit": self.unit,
            "pass": self.passed,
            "spread": self.spread if math.isfinite(self.spread) else None,
            "clock": self.clock,
        }
        return values | ({"known": self.known} if self.known else {})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Row:
        """Return a row of result.json; a measured None becomes NaN, a spread infinite.

        Raises:
            KeyError: If an entry is missing.
        """
        measured, spread = values["measured"], values["spread"]
        return cls(
            values["name"],
            values["quantity"],
            values["expected"],
            math.nan if measured is None else measured,
            values["unit"],
            values["pass"],
            math.inf if spread is None else spread,
            values["clock"],
            values.get("known", ""),
        )


def _default_spread(clock: Clock, measured: float, limit: float = 0.0) -> float:
    """Return a share of the larger of value and limit; infinities do not count."""
    sizes = [abs(v) for v in (measured, limit) if math.isfinite(v)]
    spread = _SHARE * max(sizes, default=0.0)
    if clock and math.isfinite(measured):
        spread = max(spread, _CLOCK_SHARE * abs(measured))
    return spread
