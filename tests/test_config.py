"""Configurations keep to their bounds wherever they are made, with the same words."""

import copy
import dataclasses as dc
import importlib
import inspect
import math
import pkgutil
import typing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import drake_srg
from drake_srg.arm import ArmPositionDriver
from drake_srg.common import ScenarioError
from drake_srg.config import Config, unchecked
from drake_srg.gripper import (
    GripperServoConfig,
    MinimumJerkConfig,
    SrgPositionDriver,
    TendonDriveConfig,
    UnderactuationConfig,
)
from drake_srg.objects import ObjectConfig
from drake_srg.scenario.typed_yaml import check_tree
from drake_srg.types import Box

NEED_EXTRAS = (
    "drake_srg.learning.learners",
    "drake_srg.suite.lerobot",
    "drake_srg.__main__",
)


def package_dataclasses():
    """Every dataclass of the package, once."""
    found = {}
    for info in pkgutil.walk_packages(drake_srg.__path__, "drake_srg."):
        if info.name.startswith(NEED_EXTRAS):
            continue
        for value in vars(importlib.import_module(info.name)).values():
            if inspect.isclass(value) and value.__module__.startswith("drake_srg."):
                found[value] = dc.is_dataclass(value)
    return [kind for kind, is_dataclass in found.items() if is_dataclass]


def kinds(config):
    """The type of each field, and of its entries if it is a list."""
    for name, kind in typing.get_type_hints(config).items():
        options = set(typing.get_args(kind)) - {type(None)} or {kind}
        plain = kind
        if len(options) == 1 and typing.get_origin(kind) not in (list, dict):
            (plain,) = options
        is_list = typing.get_origin(plain) is list
        yield name, plain, typing.get_args(plain)[0] if is_list else plain


BOUNDS = {"gt", "ge", "le", "among", "length", "nonempty"}
DATACLASSES = package_dataclasses()
FIELDS = [
    pytest.param(config, field, kind, entry, id=f"{config.__name__}.{field.name}")
    for config in DATACLASSES
    if issubclass(config, Config) and not inspect.isabstract(config)
    for field in dc.fields(config)
    for name, kind, entry in kinds(config)
    if name == field.name and entry in (int, float, str, bool)
]


def test_whatever_states_bounds_checks_them():
    bounded = {
        kind
        for kind in DATACLASSES
        if any(BOUNDS & field.metadata.keys() for field in dc.fields(kind))
    }
    assert len(bounded) > 50
    assert {kind.__name__ for kind in bounded if not issubclass(kind, Config)} == set()


def bad_values(field, entry):
    """Values that a field must not have, or that no entry of it may be."""
    bounds = field.metadata
    yield {str: 3, bool: 1}.get(entry, "fast")
    if entry in (int, float):
        yield from (math.nan, math.inf, True)
    if entry is int:
        yield 1.5
    if "among" in bounds:
        yield "frezze" if entry is str else -77
    for name, away in (("gt", 0), ("gt", -1), ("ge", -1), ("le", 1)):
        if name in bounds:
            yield entry(bounds[name] + away)


@pytest.mark.parametrize(("config", "field", "kind", "entry"), FIELDS)
def test_a_bad_value_is_refused_in_the_words_of_the_scenario_reader(
    config, field, kind, entry
):
    made, is_list = object.__new__(config), kind is not entry
    length = field.metadata.get("length", 1)
    wrong = [[bad] * length if is_list else bad for bad in bad_values(field, entry)]
    wrong += [[1.0] * (length + 1)] if "length" in field.metadata else []
    wrong += [[]] if is_list and field.metadata.get("nonempty") else []
    for value in wrong:
        with pytest.raises(ValueError) as told:
            setattr(made, field.name, value)
        start = f"{config.__name__}.{field.name}: "
        assert str(told.value).startswith(start)
        with pytest.raises(ScenarioError) as read:
            check_tree({field.name: value}, config, "file")
        problem = str(told.value).removeprefix(start)
        # YAML writes `true`.
        assert str(read.value).split(": ", 2)[2].lower() == problem.lower()


def good_values(field, kind, entry):
    """Values that a field may have."""
    bounds = field.metadata
    if "among" in bounds:
        values = st.sampled_from(sorted(bounds["among"]))
    elif entry in (int, float):
        least = bounds.get("gt", bounds.get("ge", -1e6))
        most = bounds.get("le", max(1e6, least))
        limits = {"min_value": entry(least), "max_value": entry(most)}
        values = st.integers(**limits) if entry is int else st.floats(**limits)
        values = values.filter(lambda value: value != bounds.get("gt"))
    else:
        values = st.text(min_size=1) if entry is str else st.booleans()
    if kind is not entry:
        size = bounds.get("length", 3)
        values = st.lists(values, min_size=size, max_size=size)
    return values


# One test a configuration: to begin one takes Hypothesis longer than ten examples.
@pytest.mark.parametrize("config", {param.values[0]: None for param in FIELDS})
def test_values_within_their_bounds_are_taken(config):
    good = {
        param.values[1].name: good_values(*param.values[1:])
        for param in FIELDS
        if param.values[0] is config
    }

    @settings(max_examples=10)
    @given(st.fixed_dictionaries(good))
    def check(values):
        made = object.__new__(config)
        for name, value in values.items():
            setattr(made, name, value)
            assert getattr(made, name) == value, name

    check()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: UnderactuationConfig(base="frezze"), "algorithm_1, freeze; got"),
        (lambda: TendonDriveConfig(wire_stiffness=-5), "greater than 0.0, got -5"),
        (lambda: TendonDriveConfig(spool_radius=0), "greater than 0.0, got 0"),
        (lambda: MinimumJerkConfig(max_velocity=None), "must be a number, got None"),
        (lambda: Box([0.1, 0.1]), "needs 3 numbers, got 2"),
        (lambda: ArmPositionDriver(home=0.0), "must be a list, got 0.0"),
        (
            lambda: dc.replace(SrgPositionDriver().servo, force_limit=7),
            "force_limit: must be at most 1.0, got 7",
        ),
        (
            lambda: setattr(SrgPositionDriver().servo, "force_limit", 7),
            "force_limit: must be at most 1.0, got 7",
        ),
    ],
)
def test_it_is_checked_where_it_is_made_and_changed(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_numbers_and_arrays_of_numpy_are_taken():
    zero = np.zeros(2)
    servo = GripperServoConfig(
        kp=np.ones(2), ki=zero, kd=zero, kff1=(0.0, 0.0), kff2=zero
    )
    servo.pwm_steps, servo.force_limit = np.int64(3), np.float32(0.5)
    with pytest.raises(ValueError, match="greater than 0"):
        servo.period = np.float64(0.0)


def test_none_is_taken_only_where_it_is_allowed():
    assert ObjectConfig(mass=None).mass is None
    with pytest.raises(ValueError, match="must be a number, got None"):
        TendonDriveConfig(spool_radius=None)


def test_floats_can_be_chosen_among_some():
    @dc.dataclass
    class Chosen(Config):
        share: float = dc.field(default=0.5, metadata={"among": (0.5, 1.0)})

    assert Chosen(1.0).share == 1.0
    with pytest.raises(ValueError, match=r"Chosen\.share: must be one of 0\.5, 1\.0"):
        Chosen(0.7)


def test_copies_are_not_checked_again():
    with unchecked():
        config = MinimumJerkConfig(period=-1.0)
    assert copy.deepcopy(config).period == copy.copy(config).period == -1.0
    with pytest.raises(ValueError, match=r"MinimumJerkConfig\.period"):
        dc.replace(config)
