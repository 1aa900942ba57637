"""Build models/sdf and models/meshes: `python tools/build_models.py [--check]`.

With --check it writes nothing and exits with 1 if a checked-in file differs.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from models import (
    assistive_arm,
    charuco,
    fits,
    gantry,
    household,
    iiwa14,
    linkage_gripper,
    packages,
    props,
    srg,
    tableware,
    workplace,
)

ROOT = Path(__file__).resolve().parent.parent / "models"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, do not write")
    check = parser.parse_args().check
    builders = (
        *(srg, iiwa14, gantry, props, household, packages, tableware),
        *(assistive_arm, linkage_gripper, workplace, charuco, fits),
    )
    files = {
        name: content.encode() if isinstance(content, str) else content
        for module in builders
        for name, content in module.build().items()
    }
    present = {
        path.relative_to(ROOT).as_posix()
        for folder, ending in (("sdf", "*.sdf"), ("meshes", "*"))
        for path in (ROOT / folder).glob(ending)
    }
    stale = sorted(present - files.keys())
    changed = sorted(
        name
        for name, content in files.items()
        if name not in present or (ROOT / name).read_bytes() != content
    )
    for name in changed:
        print(f"{'differs' if check else 'wrote'}: models/{name}")
        if not check:
            (ROOT / name).parent.mkdir(parents=True, exist_ok=True)
            (ROOT / name).write_bytes(files[name])
    for name in stale:
        print(f"{'not generated' if check else 'removed'}: models/{name}")
        if not check:
            (ROOT / name).unlink()
    if check and (changed or stale):
        print("Run python tools/build_models.py and commit its result.")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
