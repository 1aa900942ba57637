import numpy as np
from helpers import fix
from pydrake.multibody.plant import MultibodyPlant

from drake_srg.arm.gravity import GravityCompensation
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import AddDirectives


def test_the_compensation_agrees_with_the_plants_gravity():
    plant = MultibodyPlant(0.0)
    AddDirectives(plant, load_scenario("kitchen"))
    plant.Finalize()
    arm, gripper = (plant.GetModelInstanceByName(name) for name in ("arm", "gripper"))
    system = GravityCompensation(plant, ["arm", "gripper"])
    context, plant_context = system.CreateDefaultContext(), plant.CreateDefaultContext()
    generator = np.random.default_rng(0)
    for _ in range(5):
        q, fingers = generator.uniform(-1.5, 1.5, 7), generator.uniform(0, 1.5, 4)
        fix(
            system,
            context,
            arm_state=np.concatenate([q, generator.normal(size=7)]),
            gripper_state=np.concatenate([fingers, generator.normal(size=4)]),
        )
        plant.SetPositions(plant_context, arm, q)
        plant.SetPositions(plant_context, gripper, fingers)
        # The gradient of the potential energy, by central differences.
        expected = np.zeros(7)
        for i in range(7):
            energy = []
            for h in (1e-5, -1e-5):
                plant.SetPositions(plant_context, arm, q + h * np.eye(7)[i])
                energy.append(plant.CalcPotentialEnergy(plant_context))
            expected[i] = (energy[0] - energy[1]) / 2e-5
        result = system.get_output_port().Eval(context)
        np.testing.assert_allclose(result, expected, atol=1e-5)
        assert np.max(np.abs(result)) > 1.0
