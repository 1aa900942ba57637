"""Claims as data, the trials that they are judged by, and the rows that result."""

from __future__ import annotations

import dataclasses as dc
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from scipy.stats import binomtest

from drake_srg.types import Vector

# What the machine's speed does to a value: nothing, or it grows with a slower machine
# (a time), or it shrinks (a rate, such as a real-time factor).
Clock = Literal["", "time", "rate"]
# Values of a trial by the name of an axis of the grid, such as scene and seed.
Case: TypeAlias = dict[str, Any]
# What a trial returns: numbers, text, None, arrays, images; lists, mappings of them.
Measures: TypeAlias = dict[str, Any]

# Default spreads as shares: of a value or its criterion, and of a wall-clock value.
_SHARE, _CLOCK_SHARE = 0.1, 0.5
# Units suit the values, so that a millionth of one is round-off [any unit].
_ROUND_OFF = 1e-6
_OWN = "own"  # a source: we ask for it


@dc.dataclass(frozen=True)
class Bound:
    """A claim about a quantity: its value is from `low` to `high`."""

    text: str = "a number"  # how a table shows it
    low: float = -math.inf  # least value that passes
    high: float = math.inf  # largest value that passes
    size: float = 0.0  # what the default spread is a share of, beside the value itself
    # Allowed from an expected value, and then a limit of the default spread.
    deviation: float | None = None
    # How far a value may move from one run to another, or a function of the value; None
    # for the default, see `row`.
    spread: float | Callable[[float], float] | None = None
    clock: Clock = ""  # how the value depends on the machine's speed
    known: str = ""  # why the value misses the bound, where that is known
    source: str = _OWN  # of the bound: thesis, data sheet, vendor, paper, own


def number(**options: Any) -> Bound:
    """Return a bound that any finite number meets; options: `spread` and `clock`."""
    return Bound(**options)


def at_most(limit: float, **options: Any) -> Bound:
    """Return the bound of no more than a limit; for options see `Bound`."""
    return Bound(f"<= {limit:.4g}", high=limit, size=limit, **options)


def at_least(limit: float, **options: Any) -> Bound:
    """Return the bound of no less than a limit; for options see `Bound`."""
    return Bound(f">= {limit:.4g}", low=limit, size=limit, **options)


def within(
    expected: float, *, relative: float = 0.0, absolute: float = 0.0, **options: Any
) -> Bound:
    """Return the bound of a value up to a deviation; of two, the larger counts."""
    allowed = max(relative * abs(expected), absolute)
    text = f"{expected:.4g} +- {allowed:.2g}"
    low, high = expected - allowed, expected + allowed
    return Bound(text, low, high, expected, allowed, **options)


@dc.dataclass(frozen=True)
class Row:
    """A measured quantity and its criterion; `row` makes one. See also `Bound`.

    A measurement passes only if it is finite. Contact amplifies the last bits of a
    number, in which versions of Drake and processors differ: `spread` says how far the
    value may move for such reasons before somebody must look into it. A row that is
    known to miss its criterion has not passed, but the experiment does not fail.
    """

    name: str  # of the object, driver or setting that was measured
    quantity: str
    expected: str  # the criterion, such as `<= 3`
    measured: float
    unit: str  # of the value, the criterion and the spread
    passed: bool
    spread: float
    clock: Clock = ""
    known: str = ""
    source: str = ""

    @property
    def judged(self) -> bool:
        """Whether the row has a criterion."""
        return self.expected != Bound.text

    @property
    def fails(self) -> bool:
        """Whether the row misses its criterion for no known reason."""
        return not (self.passed or self.known)

    def as_dict(self) -> dict[str, str | float | bool | None]:
        """Return the row as in result.json; values that are not finite become None."""
        values = dc.asdict(self)
        values["pass"] = values.pop("passed")
        for key in ("measured", "spread"):
            values[key] = values[key] if math.isfinite(values[key]) else None
        if not self.known:
            del values["known"]
        if self.source in ("", _OWN):
            del values["source"]
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Row:
        """Return a row of result.json; a measured None becomes NaN, a spread infinite.

        Raises:
            KeyError: If an entry is missing.
        """
        judged = values["expected"] != Bound.text
        entries = {"source": _OWN if judged else ""} | dict(values)
        entries["passed"] = entries.pop("pass")
        for key, missing in (("measured", math.nan), ("spread", math.inf)):
            entries[key] = missing if entries[key] is None else entries[key]
        return cls(**entries)


def row(
    name: str, quantity: str, measured: float, unit: str, bound: Bound | None = None
) -> Row:
    """Return the row of a measured value.

    By default, the spread is a tenth of the value or of its limit, whichever is larger,
    because a change far below a limit means nothing. For `within`, it is at most the
    allowed deviation; for a wall-clock value, at least half of the value.
    """
    value, bound = float(measured), bound or Bound()
    spread = bound.spread(value) if callable(bound.spread) else bound.spread
    if spread is None:
        sizes = [abs(v) for v in (value, bound.size) if math.isfinite(v)]
        spread = _SHARE * max(sizes, default=0.0)
        if bound.deviation is not None:
            kept = bound.size != 0.0
            spread = min(bound.deviation, spread) if kept else bound.deviation
        if bound.clock and math.isfinite(value):
            spread = max(spread, _CLOCK_SHARE * abs(value))
    passed = math.isfinite(value) and bool(bound.low <= value <= bound.high)
    return Row(
        *(name, quantity, bound.text, value, unit, passed),
        spread=max(float(spread), _ROUND_OFF),
        clock=bound.clock,
        known="" if passed else bound.known,
        source="" if bound.text == Bound.text else bound.source,
    )


class Trials(Sequence[Mapping[str, Any]]):
    """Trials with their results; `trials["slip"]` is an array of that measure.

    An entry is a mapping of the trial's axes and measures. Series are arrays. `whole`
    has all trials of the experiment; `name` is that of the group.
    """

    def __init__(
        self,
        entries: Sequence[Mapping[str, Any]],
        whole: Trials | None = None,
        name: str = "",
    ):
        self._entries = list(entries)
        self.whole = self if whole is None else whole
        self.name = name

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return iter(self._entries)

    def __getitem__(self, measure: Any) -> Any:
        """Return a trial by its number, or an array of a measure.

        Scalars that are None are NaN; text stays text.
        """
        if not isinstance(measure, str):
            return self._entries[measure]
        values = [entry[measure] for entry in self._entries]
        return np.array([np.nan if value is None else value for value in values])

    def known(self, measure: str) -> Vector:
        """Return the values of a measure without those that are missing or NaN."""
        values = np.array(self[measure], dtype=float)
        return values[~np.isnan(values)]

    def one(self, measure: str) -> Any:
        """Return the value of the only trial."""
        if len(self) != 1:
            raise ValueError(f"{self.name or 'all'}: needs one trial, got {len(self)}")
        return self._entries[0][measure]

    def where(self, **axes: Any) -> Trials:
        """Return the trials with these values, such as `where(grip="wrap")`."""
        entries = [e for e in self if all(e.get(k) == v for k, v in axes.items())]
        return Trials(entries, self.whole, self.name)

    def groups(self, *axes: str) -> dict[str, Trials]:
        """Return the trials by the values of axes, joined by commas, in their order."""
        found: dict[str, list[Mapping[str, Any]]] = {}
        for entry in self:
            found.setdefault(", ".join(str(entry[a]) for a in axes), []).append(entry)
        return {name: Trials(own, self.whole, name) for name, own in found.items()}


# What is claimed of a quantity: a bound or several, bounds by the name of a group
# (others inform), or a function of the group.
Claim: TypeAlias = (
    Bound | Sequence[Bound] | Mapping[str, Bound] | Callable[[Trials], Bound | None]
)
# Values by `QUANTITY [UNIT]`, or pairs of a value and its bound, or lists of pairs.
Values: TypeAlias = dict[str, Any]


def rows_of(
    name: str, values: Values, claims: Mapping[str, Claim], own: Trials
) -> Iterator[Row]:
    """Yield the rows of numbers by `QUANTITY [UNIT]`; other entries make none.

    Quantities without a claim inform. Claims that are functions get the trials `own`.
    """
    for key, entry in values.items():
        match = re.fullmatch(r"(.*) \[(.*)\]", key, re.DOTALL)
        if not match:
            continue
        quantity, unit = match.groups()
        claim = claims.get(quantity)
        for pair in entry if isinstance(entry, list) else [entry]:
            value, bounds = pair if isinstance(pair, tuple) else (pair, None)
            if not isinstance(value, (int, float, np.number)):
                continue
            if bounds is None:
                bounds = claim(own) if callable(claim) else claim
            if isinstance(bounds, Mapping):
                bounds = bounds.get(name)
            for bound in bounds if isinstance(bounds, Sequence) else [bounds]:
                yield row(name, quantity, float(value), unit, bound)


def wilson(successes: float, trials: int) -> tuple[float, float]:
    """Return the 95 % interval (Wilson) of a share; (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    found = binomtest(int(successes), int(trials)).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def share(
    what: str,
    successes: float,
    trials: int,
    bound: Bound | None = None,
    *,
    spread: float,
    first: str = "",
) -> Values:
    """Return the share of successes and its interval, all with a spread.

    `what` is the quantity; that of the share itself ends with `first`.
    """
    low, high = wilson(successes, trials)
    value, information = successes / max(trials, 1), number(spread=spread)
    claimed = dc.replace(bound or information, spread=spread)
    return {
        f"{what}{first} []": (value, claimed),
        f"{what}, at least []": (low, information),
        f"{what}, at most []": (high, information),
    }


def counts(words: Iterable[str], unit: str, least: float) -> Values:
    """Return how often each word occurs, such as reasons of failures.

    Contact is chaotic: a count may move by `least` and three tenths of it.
    """
    return {
        f"{word} [{unit}]": (n, number(spread=least + 0.3 * n))
        for word, n in Counter(words).items()
    }


def quantiles(what: str, unit: str, values: Vector) -> Values:
    """Return median and 5 to 95 % quantiles; nothing without values."""
    shares = {"median": 0.5, "5 % quantile": 0.05, "95 % quantile": 0.95}
    return {
        f"{what}, {word} [{unit}]": float(np.quantile(values, share))
        for word, share in shares.items()
        if len(values)
    }
