"""Ports by name, of what is not a diagram yet."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Gain

from drake_srg.common.ports import Ports, input_ports, output_ports


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


def test_a_follower_gets_the_same():
    for exported in (True, False):
        builder = DiagramBuilder()
        gain, other = builder.AddSystem(Gain(2.0, 1)), builder.AddSystem(Gain(3.0, 1))
        ports = Ports(
            {"torque": gain.get_input_port()},
            {"double": gain.get_output_port(), "triple": other.get_output_port()},
            {"torque": other.get_input_port()},
        )
        if exported:
            ports.Export(builder)
            diagram = builder.Build()
            (port,) = input_ports(diagram, "torque")
            context = diagram.CreateDefaultContext()
            port.FixValue(context, [3.0])
        else:
            source = builder.AddSystem(ConstantVectorSource([3.0]))
            for port in input_ports(ports, "torque"):
                builder.Connect(source.get_output_port(), port)
            ports.inputs.clear()
            ports.Export(builder)
            diagram = builder.Build()
            context = diagram.CreateDefaultContext()
        assert diagram.GetOutputPort("double").Eval(context) == [6.0]
        assert diagram.GetOutputPort("triple").Eval(context) == [9.0]
