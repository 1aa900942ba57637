import numpy as np
import pytest

from drake_srg.experiments import convergence
from drake_srg.experiments.convergence import (
    ACCURATE,
    FINEST,
    GRIPS,
    VARIANTS,
    Grip,
    difference,
    grasp,
    run,
)
from drake_srg.experiments.registry import quiet

GRIP = Grip(True, np.array([1.0, 1.0, 0.2, 0.2]), np.array([0.0, 0.0, 18.0, 18.0]))


@pytest.mark.slow
def test_the_bench_holds_its_can():
    grip = grasp("pinched", *VARIANTS["step 4 ms"])
    assert grip.held
    assert np.all(grip.forces[2:] > 5.0)


def test_the_largest_differences_count():
    other = Grip(True, np.array([1, 1, 0.2, 0.25]), np.array([0, 0, 20.0, 18.0]))
    assert difference(GRIP, other) == pytest.approx((0.05, 0.1))
    # Contact in only one grip counts; no contact at all is not agreement.
    other = Grip(True, GRIP.angles, np.array([9.0, 0.0, 18.0, 18.0]))
    assert difference(GRIP, other) == pytest.approx((0.0, 0.5))
    nothing = Grip(False, GRIP.angles, np.zeros(4))
    assert difference(GRIP, nothing) == (0.0, np.inf)


@pytest.mark.parametrize("variant", [None, *FINEST])
def test_a_variant_that_differs_fails(monkeypatch, variant):
    def pretend(grip, scenario, changes):
        off = (scenario, changes) == VARIANTS.get(variant)
        return Grip(GRIP.held, GRIP.angles + 0.03 * off, GRIP.forces * (1 + 0.2 * off))

    monkeypatch.setattr(convergence, "grasp", pretend)
    failed = [row.name for row in run(quiet).rows if not row.passed]
    expected = [f"{grip}, {ACCURATE} against {variant}" for grip in GRIPS]
    assert sorted(set(failed)) == (sorted(expected) if variant else [])
