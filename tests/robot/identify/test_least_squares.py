import numpy as np
import pytest

from drake_srg.robot.identify.least_squares import Parameter, fit

X = np.linspace(1.0, 3.0, 20)
A, B = Parameter("a", "", 1.0, 10.0), Parameter("b", "", 1.0, 10.0)


def off(values, noise):
    return (values["a"] * X ** values["b"] - 2.0 * X**1.5 + noise) / 0.01


def test_it_finds_what_made_the_data():
    found = fit([A, B], lambda v: off(v, 0.0)).values
    assert found == pytest.approx({"a": 2.0, "b": 1.5}, rel=1e-3)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(40):
        noise = rng.normal(0.0, 0.01, len(X))
        a = fit([A, B], lambda v, noise=noise: off(v, noise)).estimates[0]
        inside += a.low <= 2.0 <= a.high
    assert 34 <= inside <= 40


def test_what_the_data_do_not_tell_stays_assumed():
    fitted = fit([A, B, Parameter("c", "", 5.0, 2.0)], lambda v: off(v, 0.0))
    a, _, c = fitted.estimates
    assert a.told
    assert not c.told
    assert c.value == pytest.approx(5.0, rel=1e-3)
    assert c.high / c.value == pytest.approx(2.0**1.96, rel=0.01)


def test_only_a_product_is_told_where_two_parameters_multiply():
    fitted = fit([A, B], lambda v: (v["a"] * v["b"] * X - 6.0 * X) / 0.01)
    assert fitted.correlation[0, 1] == pytest.approx(-1.0, abs=1e-3)
    assert not any(e.told for e in fitted.estimates)
    assert fitted.values["a"] * fitted.values["b"] == pytest.approx(6.0, rel=1e-3)


def test_data_off_by_more_than_they_say_widen_the_intervals():
    wide, narrow = (
        fit([A, B], lambda v, n=n: off(v, n * np.sin(9 * X))).estimates[0]
        for n in (0.2, 0.01)
    )
    assert wide.high / wide.low > narrow.high / narrow.low


def test_it_looks_into_several_valleys():
    parameter = Parameter("x", "", 1.0, 100.0)

    def wells(values):
        x = np.log(values["x"])
        bottom = 2.0 * (x - 2.0 * np.pi / 3.0)
        return np.concatenate([10.0 * np.sin(3.0 * x), bottom], axis=1)

    found = fit([parameter], wells, starts=[{}, {"x": 8.0}]).values["x"]
    assert np.log(found) == pytest.approx(2.0 * np.pi / 3.0, abs=0.05)
