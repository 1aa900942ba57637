import cv2
import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import ImageRgba8U

from drake_srg.lifetime import LeafSystem
from drake_srg.recording.replay.recorder import SightRecorder
from drake_srg.types import Blob, PlannerStatus

BLOB = Blob("can", "ceiling", (159.5, 59.5), RigidTransform(), quality=0.75)


class Perception(LeafSystem):
    """A camera, and a planner that looks at whole seconds from 1 s on."""

    def __init__(self, blobs):
        super().__init__()
        self.images, self.blobs = 0, blobs
        for name, model, calc in (
            ("planner.status", PlannerStatus(), self._status),
            ("camera_ceiling.color_image", ImageRgba8U(1280, 240), self._image),
            ("localizer.blobs", (BLOB,), lambda context, output: None),
        ):
            self.DeclareAbstractOutputPort(
                name=name, alloc=lambda m=model: AbstractValue.Make(m), calc=calc
            )

    def _status(self, context, output):
        output.set_value(PlannerStatus(looks=int(context.get_time()), blobs=self.blobs))

    def _image(self, context, output):
        self.images += 1
        image = output.get_mutable_value()
        image.mutable_data[:] = [200, 20, 20, 255]


def MakeCell(without=(), blobs=(BLOB,)):
    builder = DiagramBuilder()
    perception = builder.AddSystem(Perception(blobs))
    for i in range(perception.num_output_ports()):
        port = perception.get_output_port(i)
        if port.get_name() not in without:
            builder.ExportOutput(port, port.get_name())
    return builder.Build(), perception


def record(cell, cameras=("ceiling",)):
    context = cell.CreateDefaultContext()
    recorder = SightRecorder(cell, cameras)
    for time in (0.0, 0.5, 1.0, 1.5, 2.0):
        context.SetTime(time)
        recorder.sample(context)
    return recorder


def test_each_look_is_kept_once():
    cell, perception = MakeCell()
    recorder = record(cell)
    assert perception.images == 2  # nothing is rendered for nothing
    assert [sight["time"] for sight in recorder.sights] == [1.0, 2.0]
    assert [sight["image"] for sight in recorder.sights] == [0, 1]
    (blob,) = recorder.sights[0]["blobs"]
    assert blob == {"name": "can", "at": [0.125, 0.25], "quality": 0.75}
    image = cv2.imdecode(np.frombuffer(recorder.images[0], np.uint8), 1)
    assert image.shape == (120, 640, 3)  # half as large
    np.testing.assert_allclose(image[60, 300], [20, 20, 200], atol=4)


def test_without_a_localizer_nothing_is_said_of_blobs():
    cell, _ = MakeCell(["localizer.blobs"], blobs=())
    assert [set(sight) for sight in record(cell).sights] == 2 * [
        {"time", "camera", "image"}
    ]


def test_a_camera_that_the_cell_does_not_have_has_no_sights():
    assert record(MakeCell()[0], ["side"]).sights == []


def test_a_cell_without_a_status_has_no_sights():
    cell, _ = MakeCell(["planner.status"])
    assert record(cell).sights == []
