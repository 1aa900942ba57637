"""Fixtures of the tests of sweeps."""

import pytest

from sweeps.dataset.recorded_sweep import write_sweep, write_trial


@pytest.fixture(scope="session")
def sweep(tmp_path_factory):
    """Trials 3, 4 and 7 of a sweep, of 8, 5 and 10 images; 4 failed. Not to be changed.

    Trial 8 is being written, and is not there yet.
    """
    folder = write_sweep(tmp_path_factory.mktemp("sweep"))
    write_trial(folder, 3, 1.0)
    write_trial(folder, 4, 0.7, failure="dropped")
    write_trial(folder, 7, 1.25)
    write_trial(folder, 8, 0.2)
    (folder / "recordings/000008/metrics.json").unlink()
    return folder
