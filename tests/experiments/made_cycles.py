"""Made-up cycles for tests of the experiments that judge cycles."""

import numpy as np

from drake_srg.experiments.cycles import Cycle
from drake_srg.simulation.metrics import Metrics


def metrics(**changes):
    """Return the metrics of a successful cycle."""
    return Metrics(
        **{
            "scenario": "made_up",
            "seed": 0,
            "success": True,
            "failure": None,
            "attempts": 1,
            "cycles": 1,
            "cycle_time_s": 6.0,
            "time_to_placement_s": 5.0,
            "planning_wall_s": 0.5,
            "localization_error_m": [1e-5, -2e-5, 0.0],
            "localization_turn_rad": 1e-4,
            "placement_error_m": [2e-4, -1e-4, 0.0],
            "placement_tilt_rad": 1e-5,
            "grasp_lifted": True,
            "grasp_shift_m": 1e-3,
            "smoothness": -20.0,
            "hold_drift_m_per_s": 1e-5,
            "peak_contact_force_n": 5.0,
            "others_moved_m": None,
            "sim_time_s": 6.5,
            "wall_time_s": 3.0,
            "real_time_factor": 2.2,
            "artifacts": {},
            **changes,
        }
    )


def cycle(p_GO_open=(0.095, 0.0, 0.0), p_GO_held=(0.095, 0.0, 0.0), **changes):
    """Return a successful cycle whose object is exactly at the tip [m]."""
    of_cycle = {"seed": 0, "slip": 2e-4, "turn": 1e-3, "error_G": np.zeros(3)}
    of_cycle |= {key: changes.pop(key) for key in of_cycle if key in changes}
    return Cycle(
        metrics=metrics(**changes),
        p_GO_open=np.array(p_GO_open),
        p_GO_held=np.array(p_GO_held),
        **of_cycle,
    )
