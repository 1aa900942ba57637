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
    """Return what decides how floating-point arithmetic is rounded here."""
    import threadpoolctl

    config: Any = np.show_config(mode="dicts")
    found = config["SIMD Extensions"].get("found", [])
    cores = {pool.get("architecture", "") for pool in threadpoolctl.threadpool_info()}
    return " ".join([platform.machine(), *sorted(found), *sorted(cores - {""})])


def compare(
    results: dict[str, Golden], wanted: dict[str, Any], same_processor: bool
) -> list[str]:
    """Return what differs from the committed results, one line each."""
    wrong = []
    for name, result in results.items():
        if name not in wanted:
            wrong.append(f"{name}: not among the committed results")
            continue
        golden = Golden(**wanted[name])
        if result.outcome != golden.outcome:
            wrong.append(f"{name}: {result.outcome} instead of {golden.outcome}")
        if same_processor:
            keys = sorted({*result.hashes, *golden.hashes})
            other = [k for k in keys if result.hashes.get(k) != golden.hashes.get(k)]
            if other:
                wrong.append(f"{name}: other bytes: {', '.join(other)}")
    return wrong


def run_all(cases: list[Case], jobs: int) -> tuple[dict[str, Golden], list[str]]:
    """Return the results by name, and what failed."""
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


def _accept(file: Path, here: str, results: dict[str, Golden]) -> None:
    """Write results, beside those of other cases from the same processor."""
    known = json.loads(file.read_text("utf-8")) if file.exists() else {}
    kept = known["results"] if known.get("processor") == here else {}
    kept |= {name: vars(result) for name, result in results.items()}
    written = {"processor": here, "results": dict(sorted(kept.items()))}
    file.write_text(json.dumps(written, indent=1) + "\n", encoding="utf-8")


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
    file = FOLDER / f"drake-{version}.json"
    here = processor()
    if arguments.accept:
        _accept(file, here, results)
    if not file.exists():
        file = max(FOLDER.glob("drake-*.json"))
    committed = json.loads(file.read_text("utf-8"))
    same = file.stem == f"drake-{version}" and committed["processor"] == here
    if not same:
        print(f"golden: outcomes only: {file.stem} on {committed['processor']},")
        print(f"        not drake-{version} on {here}")
    wanted = committed["results"]
    wrong = failed + compare(results, wanted, same)
    print("\n".join(wrong) or f"golden: {len(results)} cases, all as committed")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
