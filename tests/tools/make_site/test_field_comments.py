import dataclasses as dc

import pytest

from make_site.field_comments import class_comments, unit_of


@dc.dataclass
class Example:
    """Looks like ours."""

    # Time to wait [s].
    # And why.
    wait: float = 0.0
    # How far, and how far at most [m].
    far: float = 1.0
    farthest: float = 2.0
    name: str = ""  # who waits

    alone: float = 0.0


class Derived(Example):
    """Inherits comments."""


@pytest.fixture(params=[Example, Derived])
def comments(request):
    return class_comments(request.param)


def test_comments_stand_above_or_behind_a_field(comments):
    assert comments["wait"] == "Time to wait [s]. And why."
    assert comments["name"] == "who waits"


def test_fields_of_one_type_share_the_comment_above_them(comments):
    assert comments["far"] == comments["farthest"]


def test_a_blank_line_or_another_type_ends_a_comment(comments):
    assert comments["alone"] == ""


@pytest.mark.parametrize(
    ("comment", "unit"),
    [
        ("Time to wait [s].", "s"),
        ("[x, y] on the table [m]", "m"),
        ("N m / rad", "N m / rad"),
        ("rad, about the vertical", "rad"),
        ("Damping of each hinge [N m s/rad]: critical.", "N m s/rad"),
        ("rad/s² or m/s²", "rad/s² or m/s²"),
        ("Share of the width.", ""),
        ("sees it", ""),
    ],
)
def test_units(comment, unit):
    assert unit_of(comment) == unit
