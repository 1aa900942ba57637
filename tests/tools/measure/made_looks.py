"""Made-up looks at a kitchen, good and bad."""

import dataclasses as dc

import numpy as np

from drake_srg.experiments.varied_scenes import Obstacles, Scene
from measure.threshold_scenes import GROUPS, Look

KITCHEN = GROUPS[0]
CLEAN = Obstacles(missed=0, invented=0, errors=())
GOOD = Look(KITCHEN, Scene(1e-3, True), CLEAN, 0.1)
UNSEEN = dc.replace(GOOD, scene=Scene(np.nan, False, np.nan))
OFF = dc.replace(GOOD, scene=Scene(5e-3, True))
DOUBTED = dc.replace(GOOD, scene=Scene(1e-3, False))
TURNED = dc.replace(GOOD, scene=Scene(1e-3, True, np.deg2rad(6.0)))
MISSED = dc.replace(GOOD, obstacles=Obstacles(2, 1, ()))
NEARER = dc.replace(GOOD, scene=Scene(0.5e-3, True))
