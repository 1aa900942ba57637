"""Tests of values that copies of a context share."""

import ast
import copy
import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.value import AbstractValue

import drake_srg
from drake_srg.common.shared import Shared, make_read_only
from drake_srg.planning.state_machine import MachineState


@dc.dataclass(frozen=True)
class Part:
    v: np.ndarray


@dc.dataclass(frozen=True)
class Pair:
    part: Part
    v: np.ndarray


@dc.dataclass(frozen=True)
class Value(Shared):
    a: np.ndarray
    parts: tuple[Part, ...] = ()
    named: dict[str, list[np.ndarray]] = dc.field(default_factory=dict)
    kind: type = Part


def test_copies_share_arrays_that_nobody_can_change():
    value = Value(np.zeros(2), (Part(np.ones(3)),), {"b": [np.zeros(1)]})
    assert copy.deepcopy(value) is value
    assert AbstractValue.Make(value).Clone().get_value() is value
    for array in (value.a, value.parts[0].v, value.named["b"][0]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5.0
    changed = dc.replace(value, a=np.ones(2))
    with pytest.raises(ValueError, match="read-only"):
        changed.a[0] = 5.0


def test_what_is_no_array_stays_as_it_is():
    for value in (None, 1.0, "text", Part, {1, 2}, np.float64(3.0)):
        make_read_only(value)


def test_what_is_taken_over_from_an_earlier_value_is_not_looked_at_again():
    kept, new = Part(np.zeros(2)), np.zeros(3)
    earlier = {"unlike": kept}
    make_read_only(Pair(kept, new), Pair(kept, np.zeros(3)))
    assert kept.v.flags.writeable
    assert not new.flags.writeable
    make_read_only(Pair(kept, new), earlier)  # of another kind: all of it is looked at
    assert not kept.v.flags.writeable


def test_what_a_machine_remembers_is_read_only():
    memory = Part(np.zeros(2))
    MachineState("mode", memory)
    with pytest.raises(ValueError, match="read-only"):
        memory.v[0] = 1.0


def test_no_other_class_is_its_own_deep_copy():
    root = Path(drake_srg.__file__).parent
    found = {
        f"{path.relative_to(root)}:{node.name}"
        for path in root.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and any(getattr(part, "name", "") == "__deepcopy__" for part in node.body)
    }
    shared = {"common/shared.py:Shared"}
    # Arrays in a machine's memory become read-only where its state is made.
    machine = {
        "planning/state_machine.py:MachineState",
        "planning/state_machine.py:Memory",
    }
    assert found == shared | machine, "derive it from Shared"
