"""Summarizes a sweep as text."""

from __future__ import annotations

import collections
import statistics
from typing import Any

from drake_srg.sweeps.statistics import wilson_interval


def summary(rows: Any) -> str:
    """Return a short table: success rate, grasps, failures by reason, median times.

    Args:
        rows: A pyarrow.Table from `rows.read_rows`.
    """
    trials = rows.num_rows
    succeeded = sum(rows["success"].to_pylist())
    low, high = wilson_interval(succeeded, trials)
    share = f", {succeeded / trials:.2%}" if trials else ""
    failures = collections.Counter(f for f in rows["failure"].to_pylist() if f)
    wrong = sum(
        claimed and not success
        for claimed, success in zip(
            rows["claimed"].to_pylist(), rows["success"].to_pylist(), strict=True
        )
    )
    lifted = [lift for lift in rows["grasp_lifted"].to_pylist() if lift is not None]

    def median(name: str) -> str:
        times = rows.filter(rows["success"])[name].drop_null().to_pylist()
        return f"{statistics.median_low(times):.3g} s" if times else "-"

    lines = [
        ("success", f"{succeeded} of {trials}{share}"),
        ("95 % interval (Wilson)", f"{low:.2%} to {high:.2%}"),
        ("grasped and lifted", f"{sum(lifted)} of {len(lifted)}"),
        *((f"failure: {name}", str(n)) for name, n in failures.most_common()),
        ("wrongly reported done", str(wrong)),
        ("median to placement", median("time_to_placement_s")),
        ("median cycle", median("cycle_time_s")),
    ]
    return "\n".join(f"{name:24} {value}" for name, value in lines)
