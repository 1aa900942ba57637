import dataclasses as dc

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.types import Blob, BlobFlag

PLAIN = Blob("can", "eye", (1.0, 2.0), np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.9)
HIDDEN = frozenset({BlobFlag.OCCLUDED})
UNCERTAIN = frozenset({BlobFlag.UNCERTAIN})


def blob(**changes):
    return dc.replace(PLAIN, **changes)


def test_trust_ranks_certainty_then_shape_then_flags_then_outline():
    best_first = [
        blob(),
        blob(quality=0.5),
        blob(quality=1.0, flags=HIDDEN),
        blob(quality=1.0, misfit=0.05),
        blob(quality=1.0, misfit=0.05, flags=HIDDEN),
        blob(quality=1.0, flags=UNCERTAIN),
    ]
    assert sorted(best_first, key=lambda b: b.trust, reverse=True) == best_first


blobs = st.builds(
    blob,
    misfit=st.floats(0.0, 2.0),
    quality=st.floats(0.0, 1.0),
    flags=st.frozensets(st.sampled_from(BlobFlag)),
)


@given(blobs, st.floats(0.04, 1.0))
def test_more_misfit_means_less_trust(one, more):
    assert dc.replace(one, misfit=one.misfit + more).trust < one.trust


def test_a_difference_in_misfit_within_noise_does_not_decide():
    assert blob(misfit=0.008).trust > blob(misfit=0.004, quality=0.8).trust
    assert blob(misfit=0.008).trust > blob(misfit=0.004, flags=HIDDEN).trust
