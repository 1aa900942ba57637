import dataclasses as dc

import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.experiments.still import take_picture
from drake_srg.objects.config import ObjectConfig
from drake_srg.scenario import RecordingConfig
from drake_srg.simulation.rig import Rig, bench_scenario
from drake_srg.types import Sphere

BALL = ObjectConfig(shape=Sphere(0.04), mass=0.1, friction=1.0, color=[1.0, 0.0, 0.0])


@pytest.mark.slow
def test_the_point_looked_at_is_in_the_middle():
    bench = bench_scenario(BALL)
    rig = Rig(bench)
    q = rig.plant.GetPositions(rig.plant_context)
    image = take_picture(bench, q, rig.X_WO().translation(), 64)
    assert image.shape == (64, 64, 3)
    red = (image[:, :, 0] > 80) & (image[:, :, 1] < 40)
    middle = np.argwhere(red).mean(axis=0)
    np.testing.assert_allclose(middle, 31.5, atol=1.5)


def test_a_picture_needs_a_camera():
    bench = dc.replace(bench_scenario(BALL), recording=RecordingConfig())
    with pytest.raises(ScenarioError, match=r"recording\.video_camera: must name"):
        take_picture(bench, np.zeros(0), np.zeros(3), 8)
