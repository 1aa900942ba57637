"""The driven arm of the kitchen, with a gripper whose fingers are limp."""

import numpy as np
from helpers import fix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ExternallyAppliedSpatialForce,
    MultibodyPlantConfig,
)
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource

from drake_srg.arm import AddArmDriver
from drake_srg.arm.external_torque import AddExternalTorque
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddDirectives, MakeModelsPlant

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
SCENARIO = load_scenario("kitchen")
MODELS = MakeModelsPlant(SCENARIO)


class DrivenArm:
    """The arm, at home and commanded to stay there, or on its way along a path."""

    def __init__(self, config, time_step=0.002, path=None, observed=False):
        builder = DiagramBuilder()
        plant_config = MultibodyPlantConfig(
            time_step=time_step, discrete_contact_approximation="lagged"
        )
        self.plant, _ = AddMultibodyPlant(plant_config, builder)
        AddDirectives(self.plant, SCENARIO)
        self.arm, gripper = (
            self.plant.GetModelInstanceByName(name) for name in ("arm", "gripper")
        )
        config.prepare_plant(self.plant, self.arm)
        self.plant.Finalize()
        self.plant.SetDefaultPositions(self.arm, HOME)
        arms = (self.arm, gripper, MODELS)
        self.driver = AddArmDriver(builder, self.plant, *arms, config)
        if path is not None:
            source = builder.AddSystem(TrajectorySource(path))
            command = self.driver.GetInputPort("position_commanded")
            builder.Connect(source.get_output_port(), command)
        if observed:
            port = AddExternalTorque(builder, self.plant, *arms, config.period)
            builder.ExportOutput(port, "external_torque")
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        if time_step == 0.0:
            cenic = SimulatorConfig(integration_scheme="cenic", max_step_size=0.005)
            ApplySimulatorConfig(cenic, self.simulator)
        self.root = self.simulator.get_mutable_context()
        self.context = self.driver.GetMyMutableContextFromRoot(self.root)
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.root)
        fingers = self.plant.get_actuation_input_port(gripper)
        fingers.FixValue(self.plant_context, [0.0] * 4)
        if path is None:
            self.command(HOME)

    def command(self, q):
        fix(self.driver, self.context, position_commanded=q)

    def advance(self, duration):
        self.simulator.AdvanceTo(self.root.get_time() + duration)

    def push(self, force, torque=(0.0, 0.0, 0.0), p_GP=(0.0, 0.0, 0.0)):
        """Apply a force [N] and a torque [N m], in world, at a point of the palm."""
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = self.plant.GetBodyByName("palm").index()
        applied.p_BoBq_B = np.array(p_GP)
        applied.F_Bq_W = SpatialForce(tau=torque, f=force)
        port = self.plant.get_applied_spatial_force_input_port()
        port.FixValue(self.plant_context, [applied])

    @property
    def q(self):
        return self.plant.GetPositions(self.plant_context, self.arm)
