import pytest

from drake_srg.experiments.table_shares import lay_in, shares
from drake_srg.planning.grasps.top_grasps import Reach
from experiments.made_tables import table

PLACE = "in the bin"
FIT = f"objects in reach that fit the hand {PLACE}"
RING = Reach((0.0, 0.0), 0.4, 0.8)


def test_shares_count_all_tables():
    found = shares([table(), table(cleared=6, picks=2, held=2)], PLACE)
    assert (found["objects in the bin"].count, found["objects in the bin"].total) == (
        *(11, 12),
    )
    assert found["picks that delivered"].value == 0.7
    assert found["picks held"].value == 0.6
    low, high = found["picks held"].bounds
    assert low < 0.6 < high


@pytest.mark.parametrize("cleared", [False, True])
@pytest.mark.parametrize(("x", "asked"), [(0.3, 0), (0.6, 1), (0.9, 0)])
def test_only_the_place_decides_what_is_in_reach(x, asked, cleared):
    made = table(total=1, cleared=int(cleared), outcome="no_grasp", lay_at=(x, 0.0))
    assert shares([made], PLACE, RING)[FIT].total == asked
    assert lay_in(RING, made.objects["clutter_1"]) == bool(asked)
    assert shares([made], PLACE)[FIT].total == 1
