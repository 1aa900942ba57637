"""Run the golden cases and compare their results with the committed ones.

The same scenario and seed give the same bytes on the same kind of processor and the
same Drake. On another processor or with another Drake, whose arithmetic differs in the
last digits, only outcomes are compared, and a line says so.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import importlib.metadata
import json
import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np

from golden.cases import QUICK, Case, Golden, all_cases, run_case

FOLDER = Path(__file__).parent


def processor() -> str:
    """Return the features of this processor that affect floating-point rounding."""
    import threadpoolctl

    config: Any = np.show_config(mode="dicts")
    found = config["SIMD Extensions"].get("found", [])
    cores = {pool.get("architecture", "") for pool in threadpoolctl.threadpool_info()}
    return " ".join([platform.machine(), *sorted(found), *sorted(cores - {""})])


def compare(
    results: dict[str, Golden], committed: dict[str, Any], here: str
) -> list[str]:
    """Return the differences from the committed results, one line each.

    Args:
        results: New results, by the case's name.
        committed: The text of a file; a case may be of another processor than most.
        here: This processor; empty to compare outcomes only.
    """
    wrong = []
    for name, result in results.items():
        if name not in committed["results"]:
            wrong.append(f"{name}: not among the committed results")
            continue
        golden = committed["results"][name]
        outcome, hashes = golden["outcome"], golden["hashes"]
        if result.outcome != outcome:
            wrong.append(f"{name}: {result.outcome} instead of {outcome}")
        if golden.get("processor", committed["processor"]) == here:
            keys = sorted({*result.hashes, *hashes})
            other = [k for k in keys if result.hashes.get(k) != hashes.get(k)]
            if other:
                wrong.append(f"{name}: other bytes: {', '.join(other)}")
    return wrong


def run_all(cases: list[Case], jobs: int) -> tuple[dict[str, Golden], list[str]]:
    """Return the results by name, and the failures."""
    results, failed = {}, []
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        futures = {pool.submit(run_case, case): case.name for case in cases}
        for future in concurrent.futures.as_completed(futures):
            name = futures[future]
            try:
                results[name] = future.result()
            except RuntimeError as error:
                failed.append(f"{name}: {error}")
            print(f"\r{len(results)} of {len(cases)}: {name:40}", end="", flush=True)
    print()
    return results, failed


def accept(
    results: dict[str, Golden], committed: dict[str, Any], here: str
) -> dict[str, Any]:
    """Return the committed results with new ones from this processor."""
    most = committed["processor"]
    others = {} if here == most else {"processor": here}
    kept = committed["results"] | {
        name: vars(result) | others for name, result in results.items()
    }
    if results.keys() >= kept.keys():
        most, kept = here, {name: vars(result) for name, result in results.items()}
    return {"processor": most, "results": dict(sorted(kept.items()))}


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="golden", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the shortest cases only")
    parser.add_argument("--only", nargs="+", default=[], help="cases whose names match")
    parser.add_argument("--accept", action="store_true", help="write the results down")
    parser.add_argument("--jobs", type=int, default=2, help="cases at a time")
    arguments = parser.parse_args()
    cases = [
        case
        for case in all_cases()
        if (not arguments.quick or case.name in QUICK)
        and (not arguments.only or any(part in case.name for part in arguments.only))
    ]
    results, failed = run_all(cases, arguments.jobs)
    version = importlib.metadata.version("drake")
    file, here = FOLDER / f"drake-{version}.json", processor()
    known = file if file.exists() else max(FOLDER.glob("drake-*.json"))
    committed = json.loads(known.read_text("utf-8"))
    if arguments.accept:
        if known != file:
            committed = {"processor": here, "results": {}}
        committed = accept(results, committed, here)
        file.write_text(json.dumps(committed, indent=1) + "\n", encoding="utf-8")
    elif known != file or committed["processor"] != here:
        print(f"golden: outcomes only: {known.stem} on {committed['processor']},")
        print(f"        not drake-{version} on {here}")
    same = here if known == file or arguments.accept else ""
    wrong = failed + compare(results, committed, same)
    print("\n".join(wrong) or f"golden: {len(results)} cases, all as committed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
