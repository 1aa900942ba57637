import numpy as np
import pytest
from helpers import fix
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from drake_srg import types
from drake_srg.types import BlobFlag
from drake_srg.vision.blob_localizer import BlobLocalizer, localize
from drake_srg.vision.camera import CameraModel
from vision.vision_scene import (
    BLUE,
    CAN,
    DOWN,
    FOV_Y,
    GREEN,
    RED,
    Camera,
    Thing,
    locate,
    make_diagram,
    standing,
    target,
)

MODEL = CameraModel(CameraInfo(640, 480, FOV_Y))
# 35 degrees off the vertical, 1.5 m above the table, looking at its middle.
OBLIQUE = Camera(
    RigidTransform(
        RotationMatrix.MakeXRotation(np.deg2rad(35)) @ DOWN, [0.0, -1.05, 1.5]
    )
)
LOW_RESOLUTION_DEPTH = Camera(
    width=1280,
    height=960,
    depth_size=(640, 480),
    X_BD=RigidTransform(RollPitchYaw(0, 0, 0.02), [0.03, 0.01, 0.0]),
)
CYLINDER_25_MM = types.Cylinder(0.0125, 0.05)
BOX = types.Box((0.0867, 0.1703, 0.0391))
BALL = types.Sphere(0.0325)


def near(blob, thing, millimetres):
    np.testing.assert_allclose(blob.position, thing.position, atol=1e-3 * millimetres)


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("millimetres", [False, True])
def test_arrays_need_no_diagram(channels, millimetres):
    diagram, localizer = make_diagram([standing(CAN, 0.05, -0.02)], [target()])
    root = diagram.CreateDefaultContext()
    context = localizer.GetMyContextFromRoot(root)
    (expected,) = localizer.GetOutputPort("blobs").Eval(context)
    color, depth, X_WB = (
        localizer.GetInputPort(f"camera.{name}").Eval(context)
        for name in ("color_image", "depth_image", "body_pose_in_world")
    )
    color, depth = color.data[..., :channels].copy(), depth.data[..., 0].copy()
    if millimetres:
        far = ~np.isfinite(depth)
        depth = np.where(far, 65.535, depth)
        depth = np.rint(1000.0 * depth).astype(np.uint16)
    model = CameraModel.from_sensor(diagram.GetSubsystemByName("camera"))
    (blob,) = localize([target()], color, depth, model, X_WB)
    if millimetres:
        np.testing.assert_allclose(blob.position, expected.position, atol=1e-3)
    else:
        assert blob.X_WO.IsExactlyEqualTo(expected.X_WO)
        assert blob.camera == "camera"


@pytest.mark.parametrize(
    ("color", "depth", "problem"),
    [
        ((10, 10, 3), np.zeros((480, 640), np.float32), "camera.color_image is 10x10"),
        (
            (480, 640, 3),
            np.zeros((480, 60), np.float32),
            "camera.depth_image is 60x480",
        ),
        ((480, 640, 3), np.zeros((480, 640), np.int64), "uint16 .mm., got int64"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(color, depth, problem):
    with pytest.raises(ValueError, match=problem):
        localize([target()], np.zeros(color, np.uint8), depth, MODEL, RigidTransform())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"targets": []}, "targets of unique names"),
        ({"targets": [target(), target()]}, "unique names.*'can', 'can'"),
        ({"cameras": {}}, "at least one camera"),
        ({"min_area": 0}, "needs min_area >= 1, got 0"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        BlobLocalizer(**{"targets": [target()], "cameras": {"top": MODEL}} | arguments)


def test_an_unconnected_input_is_named():
    localizer = BlobLocalizer([target()], {"top": MODEL})
    with pytest.raises(RuntimeError, match=r"'top\.color_image' is not connected"):
        localizer.get_output_port().Eval(localizer.CreateDefaultContext())


def test_an_image_of_the_wrong_size_is_named():
    localizer = BlobLocalizer([target()], {"top": MODEL})
    context = localizer.CreateDefaultContext()
    fix(
        localizer,
        context,
        **{
            "top.color_image": Value(ImageRgba8U(320, 240)),
            "top.depth_image": Value(ImageDepth32F(640, 480)),
            "top.body_pose_in_world": Value(RigidTransform()),
        },
    )
    with pytest.raises(ValueError, match=r"320x240 pixels.*says 640x480"):
        localizer.get_output_port().Eval(context)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "limit"), [((640, 480), 0.3), ((1280, 960), 0.1)], ids=["vga", "1.2Mpx"]
)
def test_a_can_is_found_within_the_limit_anywhere(size, limit):
    rng = np.random.default_rng(2)
    for _ in range(8):
        can = standing(CAN, *rng.uniform([-0.15, -0.2], [0.15, 0.2]))
        [blob] = locate([can], cameras={"top": Camera(width=size[0], height=size[1])})
        near(blob, can, limit)
        assert blob.axis == pytest.approx([0, 0, 1], abs=1e-3)
        assert blob.quality > 0.95
        assert blob.flags == frozenset()
        assert (blob.object_name, blob.camera) == ("can", "top")


@pytest.mark.slow
@pytest.mark.parametrize("camera", [OBLIQUE, LOW_RESOLUTION_DEPTH], ids=["35deg", "2x"])
@pytest.mark.parametrize(
    ("shape", "limit"),
    [(CAN, 0.4), (CYLINDER_25_MM, 0.8), (BOX, 1.2), (BALL, 0.1)],
    ids=["can", "cylinder", "box", "ball"],
)
def test_shapes_are_found_from_other_cameras(shape, limit, camera):
    for x, y, yaw in [(0.1, 0.15, 0.3), (-0.12, -0.1, 1.2)]:
        thing = standing(shape, x, y, rotation=RotationMatrix.MakeZRotation(yaw))
        [blob] = locate([thing], [target(shape=shape)], {"eye": camera})
        near(blob, thing, limit)
        assert blob.flags == frozenset()


def test_a_leaning_can_shows_its_axis():
    lean = RollPitchYaw(np.deg2rad(4), np.deg2rad(-3), 0.0).ToRotationMatrix()
    can = Thing(CAN, (0.05, 0.02, 0.06), rotation=lean)
    [blob] = locate([can])
    np.testing.assert_allclose(blob.axis, lean.matrix()[:, 2], atol=1e-3)
    near(blob, can, 0.4)


def test_the_pixel_is_where_the_blob_is_in_the_image():
    [blob] = locate([standing(BALL, 0.2, 0.1)], [target(shape=BALL)])
    ray = MODEL.imager("color").project(np.array([0.2, -0.1, 1.5 - 0.0325]))
    assert blob.pixel == pytest.approx(tuple(ray), abs=0.5)


def test_nothing_to_see_gives_no_blobs():
    assert locate([]) == []
    assert locate([standing(CAN, 0.0, 0.0, color=BLUE)]) == []


@pytest.mark.slow
def test_a_covered_can_is_located_by_its_side():
    can = standing(CAN, 0.1, 0.1)
    lid = Thing(types.Box((0.08, 0.08, 0.002)), (0.1, 0.1, 0.1038), BLUE)
    assert locate([can, lid]) == []
    [blob] = locate([can, lid], cameras={"eye": OBLIQUE})
    # Because its ends are hidden, it may as well stand in a hole of the table.
    assert blob.flags == {BlobFlag.OCCLUDED, BlobFlag.UNCERTAIN}
    assert blob.position[:2] == pytest.approx([0.1, 0.1], abs=4e-4)


def test_an_occluded_can_is_flagged_and_still_located():
    can = standing(CAN, 0.1, 0.1)
    bar = Thing(types.Box((0.2, 0.03, 0.02)), (0.1, 0.13, 0.3), BLUE)
    [blob] = locate([can, bar])
    assert blob.flags == {BlobFlag.OCCLUDED}
    assert 0.3 < blob.quality < 0.9
    near(blob, can, 0.6)


@pytest.mark.slow
def test_a_finger_across_a_can_leaves_one_blob():
    can = standing(CAN, 0.1, 0.1)
    finger = Thing(types.Box((0.2, 0.015, 0.02)), (0.1, 0.1, 0.2), BLUE)
    [blob] = locate([can, finger])
    assert BlobFlag.OCCLUDED in blob.flags
    near(blob, can, 0.6)


def test_a_can_at_the_border_is_flagged_and_still_located():
    can = standing(CAN, 0.2, 0.55)
    [blob] = locate([can])
    assert BlobFlag.BORDER in blob.flags
    near(blob, can, 1.0)


def test_two_objects_of_one_color_give_two_blobs():
    cans = [standing(CAN, 0.1, 0.1), standing(CAN, 0.1, -0.05)]
    blobs = locate(cans)
    assert len(blobs) == 2
    for blob, can in zip(
        sorted(blobs, key=lambda b: -b.position[1]), cans, strict=True
    ):
        near(blob, can, 0.4)


@pytest.mark.slow
def test_blobs_are_ordered_by_target_and_then_by_trust():
    things = [
        standing(CAN, 0.1, 0.1, color=RED),
        standing(CAN, -0.2, 0.55, color=RED),
        standing(BOX, -0.1, -0.1, color=GREEN),
    ]
    targets = [target("box", BOX, GREEN), target("can", CAN, RED)]
    cameras = {"top": Camera(), "oblique": OBLIQUE}
    blobs = locate(things, targets, cameras)
    names = [blob.object_name for blob in blobs]
    assert names == sorted(names)
    assert {blob.camera for blob in blobs if blob.object_name == "box"} == set(cameras)
    qualities = [blob.quality for blob in blobs if blob.object_name == "can"]
    assert len(qualities) >= 3
    assert qualities == sorted(qualities, reverse=True)
    assert qualities[-1] < qualities[0]


def test_small_specks_are_dropped():
    speck = standing(types.Cylinder(0.006, 0.05), 0.1, 0.1)
    targets = [target(shape=speck.shape)]
    assert len(locate([speck], targets)) == 1
    assert locate([speck], targets, min_area=100) == []


def test_blobs_follow_their_inputs():
    diagram, localizer = make_diagram([standing(CAN, 0.0, 0.0)], [target()])
    context = localizer.GetMyContextFromRoot(diagram.CreateDefaultContext())
    port = localizer.GetOutputPort("blobs")
    assert port.Eval(context)[0].position == pytest.approx([0, 0, 0.0509], abs=4e-4)
    # The same images show a can elsewhere if the camera is said to be elsewhere.
    pose = RigidTransform(DOWN, [0.5, 0.0, 1.6])
    localizer.GetInputPort("camera.body_pose_in_world").FixValue(context, pose)
    assert port.Eval(context)[0].position == pytest.approx([0.5, 0, 0.1509], abs=4e-4)
