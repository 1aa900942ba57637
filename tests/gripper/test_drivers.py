import numpy as np
import pytest
from helpers import fix
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from drake_srg.common import SRG
from drake_srg.common.exceptions import ScenarioError
from drake_srg.gripper import (
    AddGripperDriver,
    LinkageDriver,
    PlantServoDriver,
    SrgPositionDriver,
    SrgTendonDriver,
)
from drake_srg.parsing import AddModel
from gripper.driven_hand import LinkageHand, SrgHand


@pytest.mark.parametrize(
    ("model", "config", "allowed"),
    [
        (
            "srg",
            LinkageDriver(),
            "!SrgPositionDriver, !SrgTendonDriver, !PlantServoDriver",
        ),
        ("linkage_gripper", SrgPositionDriver(), "!LinkageDriver"),
        ("linkage_gripper", SrgTendonDriver(), "!LinkageDriver"),
        ("table", LinkageDriver(), "none"),
    ],
)
def test_a_driver_of_another_gripper_is_refused(model, config, allowed):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.005)
    gripper = AddModel(plant, f"package://drake_srg/sdf/{model}.sdf")
    plant.Finalize()
    with pytest.raises(ScenarioError) as error:
        AddGripperDriver(builder, plant, gripper, config)
    name = type(config).__name__
    assert str(error.value) == (
        f"gripper: !{name} does not fit the model; allowed: {allowed}"
    )


@pytest.mark.parametrize("driver", [SrgPositionDriver, SrgTendonDriver])
def test_the_literal_law_pushes_until_its_reference_arrives(driver):
    config = driver()
    config.servo.law = "literal"
    hand = SrgHand(config=config)
    hand.command(closure_commanded=0.1)
    hand.advance(0.05)
    assert hand.read("pwm")[0] > 0.1
    hand.advance(1.0)
    # Where the fingers are by now does not matter.
    assert hand.read("pwm") == pytest.approx(np.zeros(config.num_motors), abs=1e-12)


def test_the_literal_law_is_refused_where_references_have_no_targets():
    config = LinkageDriver()
    config.servo.law = "literal"
    with pytest.raises(ValueError, match=r"servo\.law: .* here: pid, printed"):
        LinkageHand(config=config)


def test_the_law_of_the_plant_is_refused_where_a_motor_pulls_wires():
    config = SrgTendonDriver()
    config.servo.law = "plant"
    with pytest.raises(ValueError, match=r"^gripper\.servo\.law: must be one of pid, "):
        SrgHand(config=config)


DRIVERS = [SrgPositionDriver, SrgTendonDriver, PlantServoDriver, LinkageDriver]
CLOSED = 0.4


class Hands:
    """Hands with drivers of one kind in one diagram, half a metre apart."""

    def __init__(self, config, names=("hand",), start=None, *, prepare=True):
        builder = DiagramBuilder()
        self.plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.002)
        file = "linkage_gripper" if isinstance(config, LinkageDriver) else "srg"
        models = []
        for i, name in enumerate(names):
            url = f"package://drake_srg/sdf/{file}.sdf"
            models.append(AddModel(self.plant, url, name))
            X_WP = RigidTransform([0.0, 0.5 * i, 0.5])
            palm = self.plant.GetFrameByName("palm", models[-1])
            self.plant.WeldFrames(self.plant.world_frame(), palm, X_WP)
            if prepare:
                config.prepare_plant(self.plant, models[-1])
            if start is not None:
                joints = config.layout.joint_names
                for joint, angle in zip(joints, start, strict=True):
                    started = self.plant.GetJointByName(joint, models[-1])
                    started.set_default_positions([angle])
        self.plant.Finalize()
        self.drivers = [
            AddGripperDriver(
                builder,
                self.plant,
                model,
                config,
                name=f"{name}_driver",
                scene_graph=scene_graph,
            )
            for model, name in zip(models, names, strict=True)
        ]
        self.simulator = Simulator(builder.Build())
        self.root = self.simulator.get_mutable_context()

    def command(self, **inputs):
        for driver in self.drivers:
            fix(driver, driver.GetMyMutableContextFromRoot(self.root), **inputs)

    def state(self, i=0):
        driver = self.drivers[i]
        context = driver.GetMyContextFromRoot(self.root)
        return driver.GetOutputPort("state_measured").Eval(context).copy()


@pytest.mark.parametrize("kind", DRIVERS)
def test_two_hands_move_in_one_diagram(kind):
    hands = Hands(kind(), ["left", "right"])
    hands.command(closure_commanded=0.0)
    right = hands.drivers[1]
    fix(right, right.GetMyMutableContextFromRoot(hands.root), closure_commanded=0.5)
    hands.simulator.AdvanceTo(0.8)
    assert abs(hands.state(0)).max() < 0.05
    assert hands.state(1)[:2].min() > 0.2


@pytest.mark.parametrize("kind", DRIVERS)
def test_hold_keeps_the_fingers_where_they_are(kind):
    hands = Hands(kind())
    hands.command(closure_commanded=0.3)
    hands.simulator.AdvanceTo(0.25)
    hands.command(hold=1.0)
    hands.simulator.AdvanceTo(0.6)
    held = hands.state()[:2]
    assert np.all((held > 0.05) & (held < 0.8 * closed(kind)[:2]))
    hands.command(closure_commanded=1.0)
    hands.simulator.AdvanceTo(0.9)
    # Wires still settle by a few milliradians; let go, the fingers close by 0.3 rad.
    assert hands.state()[:2] == pytest.approx(held, abs=5e-3)


def test_a_name_that_is_taken_is_refused():
    hand = Hands(SrgPositionDriver())
    builder = DiagramBuilder()
    builder.AddNamedSystem("gripper_driver", ConstantVectorSource([0.0]))
    model = hand.plant.GetModelInstanceByName("hand")
    refusal = r"^gripper_driver: the diagram already has .* \(allowed: another `name`\)"
    with pytest.raises(ValueError, match=refusal):
        SrgPositionDriver().AddDriver(builder, hand.plant, model)


def closed(kind):
    """Return the joint angles of an empty hand at `CLOSED`."""
    return kind().empty_hand(CLOSED)[1]


@pytest.mark.parametrize(
    ("in_context", "command"),
    [(False, CLOSED), (True, np.nan), (False, 0.0)],
)
@pytest.mark.parametrize("kind", DRIVERS)
def test_fingers_that_start_closed_do_not_fly(kind, in_context, command):
    q = closed(kind)
    hands = Hands(kind(), start=None if in_context else q)
    if in_context:
        context = hands.plant.GetMyMutableContextFromRoot(hands.root)
        for name, angle in zip(kind.layout.joint_names, q, strict=True):
            hands.plant.GetJointByName(name).set_angle(context, angle)
    hands.command(closure_commanded=command)
    rests = command != 0.0
    fastest = 0.0
    # At first, the linkage closes its loops, which start apart.
    for time in np.arange(0.02, 0.6 if rests else 1.4, 0.01):
        hands.simulator.AdvanceTo(time)
        fastest = max(fastest, abs(hands.state()[len(q) :]).max())
    assert fastest < (0.5 if rests else 1.01 * SRG.joint_speed)
    expected = q if rests else np.zeros(len(q))
    assert hands.state()[: len(q)] == pytest.approx(expected, abs=0.01)


def test_a_driver_whose_plant_is_not_prepared_is_refused():
    with pytest.raises(ValueError, match=r"^hand: actuator .* has no gains: call the"):
        Hands(PlantServoDriver(), prepare=False)
    position, linkage = SrgPositionDriver(), LinkageDriver()
    for config in (position, linkage):
        config.servo.law = "plant"
        with pytest.raises(ValueError, match=r"^hand: actuator .* has no gains"):
            Hands(config, prepare=False)
