import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain

from drake_srg.common.ports import export_outputs, input_ports, output_ports


def gain_diagram():
    builder = DiagramBuilder()
    gain = builder.AddSystem(Gain(2.0, 1))
    builder.ExportInput(gain.get_input_port(), "torque")
    builder.ExportOutput(gain.get_output_port(), "speed")
    builder.ExportOutput(gain.get_output_port(), "speed_again")
    return builder.Build()


def test_ports_are_listed_by_name_in_their_order():
    diagram = gain_diagram()
    assert list(input_ports(diagram)) == ["torque"]
    assert list(output_ports(diagram)) == ["speed", "speed_again"]
    assert output_ports(diagram)["speed"].get_index() == 0


def test_all_outputs_are_exported_under_their_own_names():
    builder = DiagramBuilder()
    inner = builder.AddSystem(gain_diagram())
    builder.ExportInput(inner.get_input_port(), "torque")
    export_outputs(builder, inner)
    outer = builder.Build()
    context = outer.CreateDefaultContext()
    outer.GetInputPort("torque").FixValue(context, [3.0])
    assert list(output_ports(outer)) == ["speed", "speed_again"]
    assert outer.GetOutputPort("speed_again").Eval(context) == np.array([6.0])
