import json

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.bridges.commands import CommandError
from drake_srg.bridges.topics import BLOBS, camera_topics
from drake_srg.experiments.direct_node import make_message
from drake_srg.twin.sightings import read_blobs
from drake_srg.types import Blob, BlobFlag


def told(*blobs, time=1.5):
    """The message of `serve` about blobs."""
    topic = camera_topics("ceiling", None)[BLOBS]
    return topic.convert(make_message, time, blobs).data


def blob(name="can", X_WO=None, flags=()):
    X_WO = X_WO or RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.5, -0.2, 0.05])
    return Blob(name, "ceiling", (1.0, 2.0), X_WO, 1.0, frozenset(flags))


def test_the_messages_of_a_served_station_are_understood():
    hidden = blob("mug", flags=[BlobFlag.OCCLUDED])
    uncertain = blob("box", flags=[BlobFlag.UNCERTAIN])
    can, mug = read_blobs(told(blob(), hidden, uncertain))
    assert (can.name, can.time, can.clear) == ("can", 1.5, True)
    assert can.X_WO.IsNearlyEqualTo(blob().X_WO, 1e-9)
    assert (mug.name, mug.clear) == ("mug", False)


GOOD = json.loads(told(blob()))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no JSON",
        "[]",
        "null",
        "{}",
        '{"stamp": NaN, "blobs": []}',
        '{"stamp": 1.0, "blobs": 3}',
        '{"stamp": 1.0, "blobs": [{}]}',
        *(
            json.dumps({**GOOD, "blobs": [{**GOOD["blobs"][0], **change}]})
            for change in (
                {"position": [0.0, 0.0]},
                {"position": [0.0, 0.0, np.nan]},
                {"position": "here"},
                {"orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}},
                {"orientation": {"w": 1.0}},
                {"flags": ["imaginary"]},
                {"flags": None},
            )
        ),
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(CommandError):
        read_blobs(text)
