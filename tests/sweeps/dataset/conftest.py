"""Fixtures for the tests of data sets."""

import pytest

from drake_srg.sweeps.rows import row_path
from sweeps.dataset.recorded_sweep import write_sweep, write_trial


@pytest.fixture(scope="session")
def sweep(tmp_path_factory):
    """Trials 3, 4 and 7 of a sweep, with 8, 5 and 10 images. Tests must not change it.

    Trial 4 failed, trials 2 and 6 ended in an error, and trial 8 has no row: the sweep
    is still running or was killed.
    """
    folder = write_sweep(tmp_path_factory.mktemp("sweep"))
    write_trial(folder, 3, 1.0)
    write_trial(folder, 4, 0.7, failure="dropped")
    write_trial(folder, 7, 1.25)
    for trial in (2, 6):
        write_trial(folder, trial, 0.2, failure="error")
        (folder / f"recordings/{trial:06}/metrics.json").unlink()
    write_trial(folder, 8, 0.2)
    row_path(folder, 8).unlink()
    return folder
