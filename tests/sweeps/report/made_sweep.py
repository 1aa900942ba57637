"""Made-up sweeps: rows with known causes of failure."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FRICTION = "objects.soup_can.friction"
CAMERA = "cameras.ceiling.errors.yaw"
MASS = "objects.soup_can.mass"
MODEL = "objects.clutter_0.model"
UNTRUSTED = '<script>alert("x")</script> & <b>bold</b>'
TREE = """\
# An iiwa 14 takes a soup can from a table.
objects:
  soup_can:
    friction: !Uniform {min: 0.6, max: 1.0}
    note: "</pre><script>document.title = 'broken'</script>"
"""


def made_rows(trials, *, effects=True, failure_rate=0.05, seed=0):
    """Return rows of trials, as a dict of columns.

    A share `failure_rate` of them fails: with `effects`, because of low friction and a
    yaw of the camera to either side, otherwise by chance alone. With effects, the
    camera's yaw raises the placement error, and the mass raises the cycle time.
    """
    random = np.random.default_rng(seed)
    sampled = {
        FRICTION: random.uniform(0.3, 1.0, trials),
        CAMERA: random.normal(0.0, 0.01, trials),
        MASS: random.uniform(0.279, 0.419, trials),
        "objects.clutter_0.count": random.integers(0, 4, trials),
        **{
            f"{name}[{axis}]": random.uniform(-0.2, 0.2, trials)
            for name in ("objects.soup_can.position", "lights.sun.direction")
            for axis in range(2)
        },
        **{f"cameras.ceiling.noise_{i}": random.normal(size=trials) for i in range(12)},
    }
    if effects:
        slippery = 4.0 * (0.6 - sampled[FRICTION]) / 0.3
        skewed = 6.0 * (np.abs(sampled[CAMERA]) - 0.015) / 0.01
        odds = np.logaddexp(slippery, skewed) + random.logistic(size=trials)
    else:
        odds, slippery, skewed = random.normal(size=(3, trials))
    failed = np.argsort(np.argsort(-odds)) < round(failure_rate * trials)
    reasons = np.where(skewed > slippery, "misplaced", "dropped")
    bend = np.abs(sampled[CAMERA]) if effects else random.uniform(0.0, 0.02, trials)
    offset = random.normal(0.0, 3e-4, (trials, 3)) + 0.05 * bend[:, None]
    offset[failed] += random.normal(0.0, 0.2, (np.count_nonzero(failed), 3))
    cycle = 6.5 + random.gamma(2.0, 0.1, trials)
    cycle += 2.0 * sampled[MASS] if effects else 0.0
    columns = {
        "trial": range(trials),
        "seed": range(100, 100 + trials),
        "success": ~failed,
        "failure": np.where(failed, reasons, None),
        "message": [UNTRUSTED if f else None for f in failed],
        "claimed": ~failed | (failed & (reasons == "misplaced")),
        "attempts": np.where(random.uniform(size=trials) < 0.1, 2, 1),
        "cycle_time_s": [None if f else c for f, c in zip(failed, cycle, strict=True)],
        "placement_error_m": offset,
        "localization_error_m": random.normal(0.0, 2e-4, (trials, 3)),
        "localization_turn_rad": np.abs(random.normal(0.0, 2e-3, trials)),
        "sim_time_s": cycle + 0.5,
        "planning_wall_s": random.uniform(0.1, 0.4, trials),
        "wall_time_s": cycle / 5.0,
        "real_time_factor": random.normal(5.0, 0.3, trials),
        "trial_time_s": cycle / 4.0,
        "memory_mb": random.uniform(400.0, 420.0, trials),
        "worker": [f"worker-{trial % 2}" for trial in range(trials)],
        **sampled,
        MODEL: random.choice(["mug", "cube", "banana"], trials),
    }
    plain = {
        k: v.tolist() if isinstance(v, np.ndarray) else list(v)
        for k, v in columns.items()
    }
    # Some trials have no clutter.
    plain[MODEL] = [m if t % 3 else None for t, m in enumerate(plain[MODEL])]
    return plain


def write_sweep(folder, columns, *, asked=None, **changes):
    """Write the folder that `drake-srg sweep` leaves; returns it."""
    folder.mkdir(parents=True, exist_ok=True)
    about = {
        "schema_version": 1,
        "scenario": "kitchen_varied",
        "seed": 100,
        "trials": asked or len(columns["trial"]),
        "record": "failures",
        "overrides": ["object.mass=0.3", "object.note=<i>"],
        "tree": TREE,
        "versions": {
            "drake_srg": "0.1.0",
            "drake": "1.51.1",
            "python": "3.11.7",
            "platform": "Linux",
        },
        "engine": "joblib",
        "jobs": 2,
        "started": "2026-11-21T10:00:00+00:00",
    }
    (folder / "sweep.json").write_text(json.dumps(about | changes))
    pq.write_table(pa.table(columns), folder / "trials.parquet")
    return folder
