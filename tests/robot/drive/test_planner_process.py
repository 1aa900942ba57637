import dataclasses as dc
from types import SimpleNamespace

import numpy as np

from drake_srg.planning.servoing.tracker import PoseSighting
from drake_srg.robot.drive.cameras import Picture
from drake_srg.robot.drive.planner_process import ServoEye


def test_every_picture_is_looked_at_once_and_has_its_stamp():
    picture = Picture(1.5, np.zeros((2, 3, 4), np.uint8), np.ones((2, 3), np.float32))
    pictures = [None, picture, picture, dc.replace(picture, stamp=1.6)]
    camera = SimpleNamespace(newest=lambda: pictures.pop(0))
    tracker = SimpleNamespace(sight=lambda color, depth: PoseSighting(len(pictures)))
    eye = ServoEye(tracker, camera)
    assert eye.look() is None
    seen = eye.look()
    assert (seen.frame, seen.stamp) == (2, 1.5)
    assert eye.look() is None
    assert eye.look().stamp == 1.6
