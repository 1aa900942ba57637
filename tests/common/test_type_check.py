"""What a file holds must have the types of the dataclass that it becomes."""

import dataclasses as dc

import pytest

from drake_srg.common.type_check import checked_types


@dc.dataclass
class Read:
    name: str
    jobs: int | None
    sizes: dict[str, float]


def test_right_types_pass():
    read = Read("a", None, {"b": 1.0})
    assert checked_types(read) is read


@pytest.mark.parametrize(
    "change", [{"name": 1}, {"jobs": "2"}, {"sizes": [1.0]}, {"sizes": None}]
)
def test_wrong_types_are_named(change):
    (name,) = change
    with pytest.raises(TypeError, match=f"{name}: must be"):
        checked_types(dc.replace(Read("a", 1, {}), **change))
