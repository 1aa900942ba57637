"""Metrics of made-up tables."""

import types


def table(
    total=6,
    cleared=5,
    picks=8,
    held=4,
    outcome="too_wide",
    lay_at=(0.6, 0.0),
):
    things = {
        f"clutter_{i + 1}": {
            "cleared": i < cleared,
            "outcome": "cleared" if i < cleared else outcome,
            "attempts": 1,
            "width_m": 0.2 if outcome == "too_wide" and i >= cleared else 0.06,
            "lay_at_m": lay_at,
            "moved_m": 0.8 if i < cleared else 0.0,
            "under": "",
        }
        for i in range(total)
    }
    return types.SimpleNamespace(
        success=True,
        failure=None,
        objects_total=total,
        objects_cleared=cleared,
        picks=picks,
        picks_held=held,
        picks_delivered=min(cleared, picks),
        picks_per_hour=600.0,
        sim_time_s=30.0,
        objects=things,
    )
