"""What the installed Drake can do, where supported versions differ.

Each function says since which version the answer is the same everywhere. Delete it once
that version is the oldest supported.
"""

from __future__ import annotations

import importlib.metadata

# The first version found to differ from 1.51.1, and what to install for it.
NEWER_DRAKE = "drake >= 1.58 (Python 3.12+)"
_NEWER = (1, 58)


def takes_nested_plant() -> bool:
    """Return whether CENIC finds a plant in a nested diagram (since 1.58)."""
    return _version() >= _NEWER


def takes_loop_constraints() -> bool:
    """Return whether CENIC takes ball, distance and weld constraints (since 1.58)."""
    return _version() >= _NEWER


def marks_fixed_steps() -> bool:
    """Return whether CENIC's fixed steps mark what they outdate (since 1.58)."""
    return _version() >= _NEWER


def has_fast_contact() -> bool:
    """Return whether steps with contact cost three quarters (since 1.58)."""
    return _version() >= _NEWER


def contact_approximations() -> list[str]:
    """Return the names of the discrete contact approximations (no tamsi since 1.58)."""
    from pydrake.multibody.plant import DiscreteContactApproximation

    members = DiscreteContactApproximation.__members__
    return sorted(name.removeprefix("k").lower() for name in members)


def _version() -> tuple[int, ...]:
    """Return the major and minor version."""
    numbers = importlib.metadata.version("drake").split(".")
    return tuple(int(number) for number in numbers[:2])
