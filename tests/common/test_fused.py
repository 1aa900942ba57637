import gc
import weakref

import numpy as np
import pytest
from helpers import fix
from pydrake.systems.analysis import Simulator

from drake_srg.common.fused import FusedStages, StagePort
from drake_srg.common.stages import StageOutput, StageSystem


class Square(StageSystem):
    """Squares its input, counts how often, and keeps the square."""

    def __init__(self, period):
        super().__init__()
        self.calls = 0
        self.declare_stage(
            inputs={"x": 1},
            outputs={
                "square": StageOutput(1, self._square, reads=("x",)),
                "kept": StageOutput(1, lambda time, state: state),
            },
            state=[0.0],
            period=period,
        )

    def update(self, time, state, x):
        return x

    def _square(self, time, state, x):
        self.calls += 1
        return x * x


def make(period=0.5):
    """A square that two others keep, one of them every second time."""
    stages = {"a": Square(0.25), "b": Square(0.25), "c": Square(period)}
    wires = {
        StagePort("a", "x"): "u",
        StagePort("b", "x"): StagePort("a", "square"),
        StagePort("c", "x"): StagePort("a", "square"),
    }
    outputs = {"b": StagePort("b", "kept"), "through": StagePort("a", "square")}
    return FusedStages(stages, wires, outputs), stages


def run(fused, time):
    simulator = Simulator(fused)
    fix(fused, simulator.get_mutable_context(), u=3.0)
    simulator.AdvanceTo(time)
    return simulator.get_context()


@pytest.mark.parametrize(("period", "calls"), [(0.25, 4), (0.5, 4 + 2)])
def test_an_event_computes_an_output_once(period, calls):
    fused, stages = make(period)
    context = run(fused, 1.0)
    # Four updates before 1 s; `c`, if its period is another, has two events more.
    assert stages["a"].calls == calls
    assert fused.GetOutputPort("b").Eval(context) == 9.0
    assert np.array_equal(
        context.get_discrete_state_vector().CopyToVector(), [3.0, 9.0, 9.0]
    )


def test_what_nothing_reads_is_not_computed():
    fused, stages = make()
    run(fused, 1.0)
    assert stages["b"].calls == stages["c"].calls == 0


def test_outputs_depend_on_what_their_stages_read():
    fused, _ = make()
    feeds = [
        fused.HasDirectFeedthrough(fused.GetOutputPort(name).get_index())
        for name in ("b", "through")
    ]
    assert feeds == [False, True]


def test_the_system_is_freed():
    fused, _ = make()
    run(fused, 0.5)
    reference = weakref.ref(fused)
    del fused
    gc.collect()
    assert reference() is None
