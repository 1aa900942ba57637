"""The cell with a visual servo, and a camera in the hand that fails on the way."""

import functools

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from drake_srg.common.systems import input_ports, output_ports
from drake_srg.lifetime import LeafSystem
from drake_srg.planning.servoing.config import ServoFault, ServoState
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.scenario import load_scenario, servo_of
from drake_srg.station import MakeCell
from drake_srg.station.plant import MakeModelsPlant
from drake_srg.station.station import MakeStation
from drake_srg.types import Failure, Mode

_IMAGES = {"color_image": ImageRgba8U(), "depth_image": ImageDepth32F()}
# CENIC needs the plant in the outermost diagram, not behind a camera.
_OVERRIDES = (
    "planner.max_attempts=1",
    "plant_config.time_step=0.005859375",
    "simulator_config.integration_scheme=explicit_euler",
)
_FEW = 6  # images of the hand's camera, before it fails


class BrokenCamera(LeafSystem):
    """Passes images on, until `fault` makes them freeze, or show only dark noise."""

    def __init__(self):
        super().__init__()
        self.fault = None
        self._latest = {}
        self._noise = np.random.default_rng(0)
        for name, model in _IMAGES.items():
            port = self.DeclareAbstractInputPort(
                name + "_in", AbstractValue.Make(model)
            )
            self.DeclareAbstractOutputPort(
                name,
                AbstractValue.Make(model).Clone,
                functools.partial(self._calc, name, port),
            )

    def _calc(self, name, port, context, output):
        output.set_value(self._image(name, port.Eval(context)))

    def _image(self, name, seen):
        if self.fault == "covered":
            image = type(seen)(seen.width(), seen.height())
            image.mutable_data[:] = self._noise.integers(0, 3, image.shape)
            return image
        if self.fault is None:
            self._latest[name] = type(seen)(seen.width(), seen.height())
            self._latest[name].mutable_data[:] = seen.data
        return self._latest[name]


def station_with(broken):
    """Return a factory of stations, with a system behind the camera in the hand."""

    def make(scenario):
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", MakeStation(scenario))
        builder.AddSystem(broken)
        for name, port in input_ports(station).items():
            builder.ExportInput(port, name)
        for name, port in output_ports(station).items():
            image = name.removeprefix("camera_hand.")
            if image in _IMAGES:
                builder.Connect(port, broken.GetInputPort(image + "_in"))
                builder.ExportOutput(broken.GetOutputPort(image), name)
            else:
                builder.ExportOutput(port, name)
        return builder.Build()

    return make


@pytest.mark.parametrize(
    ("broken", "fault"), [("frozen", ServoFault.FROZEN), ("covered", ServoFault.LOST)]
)
def test_a_camera_that_fails_stops_the_hand_and_is_told(broken, fault):
    scenario = load_scenario("kitchen_servoing", overrides=_OVERRIDES)
    camera, arm = BrokenCamera(), ServoArm(MakeModelsPlant(scenario))
    cell = MakeCell(scenario, station_with(camera))
    simulator = Simulator(cell)
    ApplySimulatorConfig(scenario.simulator_config, simulator)
    root = simulator.get_context()
    servo = cell.GetSubsystemByName("planner").GetOutputPort("servo_status")
    planner = cell.GetSubsystemByName("planner").GetMyContextFromRoot(root)
    state, status = (
        cell.GetOutputPort(name) for name in ("arm.state_cheat", "planner.status")
    )

    def hand():
        q, v = np.split(state.Eval(root), 2)
        return float(np.linalg.norm(arm.jacobian(q)[:3] @ v))

    faults, failed_at, speeds = set(), np.inf, []
    while status.Eval(root).mode not in (Mode.DONE, Mode.FAILED):
        assert root.get_time() < 20.0
        simulator.AdvanceTo(root.get_time() + servo_of(scenario).camera_period)
        seen = servo.Eval(planner)
        if seen.images >= _FEW:
            camera.fault = broken
        if seen.fault is not None:
            faults.add(seen.fault)
            failed_at = min(failed_at, root.get_time())
        if seen.state is not ServoState.PASSING and root.get_time() > failed_at + 0.4:
            speeds.append(hand())
    assert faults == {fault}
    assert max(speeds, default=0.0) < 0.01
    assert status.Eval(root).mode is Mode.FAILED
    assert status.Eval(root).failure is Failure.NOT_SEEN
    assert fault.value in status.Eval(root).message
