import dataclasses as dc

import numpy as np
import pytest

from drake_srg.experiments.thesis_messages import (
    CASES,
    Witnessed,
    demonstrate,
    draw,
    messages,
    rows_of,
)
from drake_srg.robot.serve.loop import Served
from drake_srg.scenario import load_scenario

NAME = "thesis_kitchen"
WELL = Witnessed(
    sent=5752,
    served=Served(240.0, 240.0, 5752),
    time=np.array([0.0, 120.0, 240.0]),
    position=np.array([[-0.8, 0.0, 0.07], [0.0, 0.0, 1.4], [-0.799, 0.0, 0.07]]),
    tilt=np.array([0.0, 90.0, 0.1]),
)


def failed(one):
    return [row.quantity for row in rows_of(NAME, one) if not row.passed]


def test_a_can_that_is_carried_and_put_back_passes():
    assert failed(WELL) == []


@pytest.mark.parametrize(
    "fault, quantity",
    [
        ({"sent": 5753}, "messages received"),
        ({"served": Served(200.0, 240.0, 5752)}, "pace"),
        ({"position": WELL.position * [1.0, 1.0, 0.9]}, "largest height"),
        (
            {"position": np.add(WELL.position, [[0.0], [0.0], [0.004]])},
            "distance from its original place",
        ),
        ({"tilt": np.array([0.0, 90.0, 90.0])}, "tilt at the end"),
    ],
)
def test_each_fault_fails_its_row(fault, quantity):
    assert quantity in failed(dc.replace(WELL, **fault))


def test_the_messages_are_those_of_the_thesis():
    sent = list(messages(load_scenario(NAME)))
    assert len(sent) == 5752
    topics = [next(iter(message)) for message in sent]
    assert topics.count("/kuka") == 5752 - 2002
    grip = [m["/grasp"] for m in sent if "/grasp" in m]
    assert grip == [i // 10 for i in [*range(1001), *range(1000, -1, -1)]]
    np.testing.assert_allclose(
        np.rad2deg(sent[500]["/kuka"]), [5, -71, 0, 110, 0, 90, 0]
    )


@pytest.mark.slow
def test_a_short_demonstration_leaves_the_can_in_place():
    overrides = ["planner.messages.rate=500", "planner.messages.rest=0.3"]
    overrides += ["planner.messages.sequence=[{routine: closehalf, mode: close}]"]
    one = demonstrate(NAME, "ROS 2", overrides)
    assert one.sent == one.served.commands == 501
    assert one.time[0] < one.time[-1] <= one.served.sim_time
    np.testing.assert_allclose(one.position[-1], one.position[0], atol=1e-3)
    assert one.tilt.max() < 1.0


def test_the_figure_shows_every_case():
    axes = draw(dict.fromkeys(CASES, WELL)).axes
    assert [ax.get_title(loc="left").split(",")[0] for ax in axes] == [*CASES]
