"""The command behind `make docs`."""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from sphinx.cmd.build import build_main

from make_site.check import problems
from make_site.gallery import record_replays
from make_site.stage import stage, update
from make_site.systems import ROOT


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the site and check it; returns the exit code.

    Exit codes: 0, the site is complete; 1, Sphinx warned, or a check failed.
    """
    parser = argparse.ArgumentParser(prog="make_site", description="Build the site.")
    parser.add_argument("--out", type=Path, default=ROOT / "out/site", metavar="DIR")
    parser.add_argument(
        "--jobs", default="auto", metavar="J", help="Sphinx's processes"
    )
    chosen = parser.parse_args(arguments)
    out, jobs = chosen.out, str(chosen.jobs)
    html, source = out / "html", out / "source"
    stage(out / "staged")
    update(source, out / "staged")
    record_replays(out / "runs", out / "extra/replays")
    shutil.rmtree(html, ignore_errors=True)
    options = ["--fail-on-warning", "--keep-going", "--quiet", "-b", "html", "-j", jobs]
    options += ["-d", str(out / "doctrees")]
    if build_main([*options, str(source), str(html)]) != 0:
        return 1
    for problem in (found := problems(html)):
        print(f"site: {problem}", file=sys.stderr)
    if not found:
        print(html / "index.html")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
