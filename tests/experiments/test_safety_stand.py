import numpy as np
import pytest

from drake_srg.arm.drivers import ArmPositionDriver
from drake_srg.experiments.safety_stand import Settling
from drake_srg.scenario import load_scenario
from drake_srg.station.plant import MakeModelsPlant

HOME = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.5, 0.0])
SLOW = 0.01  # rad/s


@pytest.mark.parametrize("seed", range(4))
def test_an_arm_settles_within_the_bound(seed):
    """The same joints, integrated: they follow a ramp that ends at time 0."""
    plant = MakeModelsPlant(load_scenario("kitchen"))
    driver, step = ArmPositionDriver(), 1e-4
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, plant.GetModelInstanceByName("arm"), HOME)
    mass = plant.CalcMassMatrix(context)[:7, :7]
    random = np.random.default_rng(seed)
    deceleration = random.uniform(-20.0, 20.0, 7)
    braking = random.uniform(0.02, 0.3)
    q = x = np.zeros(7)
    v, last = braking * deceleration, 0.0
    for t in np.arange(-braking, 0.6, step):
        speed = deceleration * max(-t, 0.0)
        q = q + step * speed
        torque = driver.kp * (q - x) + driver.kd * (speed - v)
        v = v + step * np.linalg.solve(mass, torque)
        x = x + step * v
        if t > 0.0 and np.any(np.abs(v) > SLOW):
            last = t
    bound = Settling(plant, driver, step).time(HOME, deceleration, SLOW)
    # It allows for other signs, and for a longer ramp, which has made all of the lag.
    assert 0.6 * bound < last <= bound + 1e-3


def test_longer_steps_damp_more_slowly():
    plant = MakeModelsPlant(load_scenario("kitchen"))
    times = [
        Settling(plant, ArmPositionDriver(), step).time(HOME, np.full(7, 17.0), SLOW)
        for step in (1e-4, 5e-3)
    ]
    assert times[0] < times[1] < 1.3 * times[0]
