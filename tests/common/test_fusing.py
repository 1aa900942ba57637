import itertools

import numpy as np
import pytest
from helpers import fix, port_table
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain, VectorLogSink

from drake_srg.common.fusing import FUSED, FusingBuilder
from drake_srg.common.stages import StageOutput, StageSystem


class Mixer(StageSystem):
    """Keeps a mix of its inputs; any lost or additional delay changes the result."""

    def __init__(self, number, period):
        super().__init__()
        self._number = number
        self.declare_stage(
            inputs={"a": 1},
            optional={"b": 1},
            outputs={
                "kept": StageOutput(1, lambda time, state: state[:1]),
                "passed": StageOutput(1, self._passed, reads=("a",), timed=True),
            },
            state=[number, 0.0],
            period=period,
        )

    def start(self, time, state, a, b):
        return [state[0] + a[0], time]

    def update(self, time, state, a, b):
        if self._number == 2 and state[0] > 3.0:
            return None
        other = -1.0 if b is None else b[0]
        return [0.5 * state[0] + 0.3 * a[0] + 0.1 * other * self._number, time]

    def _passed(self, time, state, a):
        return [np.sin(time) + state[0] - 0.2 * a[0]]


PERIODS = (0.25, 0.5, 0.375)


def make(builder, wires, periods):
    """A chain of mixers: `passed` feeds forwards, `kept` back, both may."""
    mixers = [
        builder.AddNamedSystem(f"mixer_{i}", Mixer(i, period))
        for i, period in enumerate(periods)
    ]
    gain = builder.AddNamedSystem("gain", Gain(2.0, 1))
    builder.ExportInput(mixers[0].GetInputPort("a"), "u")
    builder.ConnectInput("u", gain.get_input_port())
    builder.Connect(gain.get_output_port(), mixers[1].GetInputPort("a"))
    builder.Connect(mixers[1].GetOutputPort("passed"), mixers[2].GetInputPort("a"))
    for target, source in enumerate(wires):
        if source is not None:
            kept = mixers[source].GetOutputPort("kept")
            builder.Connect(kept, mixers[target].GetInputPort("b"))
    outer = builder.AddNamedSystem("outer", Gain(3.0, 1))
    builder.Connect(mixers[2].GetOutputPort("passed"), outer.get_input_port())
    builder.ExportOutput(outer.get_output_port(), "outer")
    for mixer, port in itertools.product(mixers, ("kept", "passed")):
        builder.ExportOutput(mixer.GetOutputPort(port), f"{mixer.get_name()}.{port}")
    return builder.Build()


def run(diagram):
    """All outputs at all steps, from a start later than 0."""
    builder = DiagramBuilder()
    system = builder.AddSystem(diagram)
    sinks = []
    for i in range(system.num_output_ports()):
        sinks.append(builder.AddSystem(VectorLogSink(1, 0.125)))
        builder.Connect(system.get_output_port(i), sinks[-1].get_input_port())
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    fix(system, system.GetMyMutableContextFromRoot(root), u=0.7)
    root.SetTime(0.125)
    simulator.AdvanceTo(2.0)
    return np.concatenate([sink.FindLog(root).data() for sink in sinks])


@given(
    st.tuples(*[st.none() | st.integers(0, 2)] * 3),
    st.tuples(*[st.sampled_from(PERIODS)] * 3),
)
def test_fused_stages_give_the_same_bits(wires, periods):
    wired = make(DiagramBuilder(), wires, periods)
    fused = make(FusingBuilder(), wires, periods)
    assert port_table(fused) == port_table(wired)
    assert run(fused).tobytes() == run(wired).tobytes()


def test_stages_of_one_period_share_an_event():
    fused = make(FusingBuilder(), (2, 0, 1), (0.5, 0.5, 0.25))
    system = fused.GetSubsystemByName(FUSED)
    with pytest.raises(RuntimeError, match="more than one"):
        system.EvalUniquePeriodicDiscreteUpdate(system.CreateDefaultContext())
    assert len(fused.GetSystems()) == 3  # the two gains as they are


def test_a_required_input_without_a_source_is_told():
    builder = FusingBuilder()
    builder.AddNamedSystem("mixer", Mixer(0, 0.5))
    with pytest.raises(ValueError, match="mixer: input port 'a' has no source"):
        builder.Build()
