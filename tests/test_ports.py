"""Ports by name, of what is not a diagram yet."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Gain

from drake_srg.ports import Ports, output_ports


def test_a_diagram_exports_them_by_their_names():
    builder = DiagramBuilder()
    gain = builder.AddSystem(Gain(2.0, 1))
    ports = Ports({"torque": gain.get_input_port()}, {"speed": gain.get_output_port()})
    assert ports.GetInputPort("torque") is ports.inputs["torque"]
    assert output_ports(ports) == {"speed": ports.GetOutputPort("speed")}
    ports.Export(builder)
    diagram = builder.Build()
    assert list(output_ports(diagram)) == ["speed"]
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("torque").FixValue(context, [3.0])
    assert diagram.GetOutputPort("speed").Eval(context) == np.array([6.0])
