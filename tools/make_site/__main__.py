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
    _tell("1 of 4: writing the reference pages")
    stage(out / "staged")
    update(source, out / "staged")
    _tell("2 of 4: recording the gallery's runs, which takes minutes the first time")
    record_replays(out / "runs", out / "extra/replays")
    _tell("3 of 4: building the pages")
    shutil.rmtree(html, ignore_errors=True)
    options = ["--fail-on-warning", "--keep-going", "--quiet", "-b", "html", "-j", jobs]
    options += ["-d", str(out / "doctrees")]
    if build_main([*options, str(source), str(html)]) != 0:
        return 1
    _tell("4 of 4: checking links and files")
    for problem in (found := problems(html)):
        print(f"site: {problem}", file=sys.stderr)
    if not found:
        print(html / "index.html")
    return 1 if found else 0


def _tell(step: str) -> None:
    """Announce the next step on standard error."""
    print(f"site: {step}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
