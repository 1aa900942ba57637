"""Run experiments and put their figures and rows into docs/experiments.md.

`python tools/update_experiment_docs.py [NAME]...` runs the named experiments, or all of
them. With `--keep`, it uses results that are already in out/experiments. It appends a
section for an experiment that the page does not have yet.
"""

import argparse
import io
import json
import re
import sys
from pathlib import Path

from PIL import Image

from drake_srg.experiments.registry import (
    list_experiments,
    list_measurements,
    run_experiment,
)

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "experiments.md"
FIGURES = ROOT / "docs" / "experiments"
RESULTS = ROOT / "out" / "experiments"
LARGEST = 100_000  # file size of a figure on the page [bytes]


def update(page: str, name: str, description: str, rows: list[dict]) -> str:
    """Return the page with the rows of an experiment replaced."""
    if f"\n## {name}\n" not in page:
        page += (
            f"\n## {name}\n\n{description}\n"
            f"\n![{description}](experiments/{name}.png)\n"
            f"\n<!-- {name}: generated -->\n<!-- end -->\n"
        )
    marked = rf"(<!-- {name}: generated -->\n).*?(<!-- end -->)"
    page, count = re.subn(
        marked,
        lambda match: match[1] + table(rows) + match[2],
        page,
        flags=re.DOTALL,
    )
    if count != 1:
        sys.exit(f"{PAGE.name}: {name}: needs one pair of markers, got {count}")
    return page


def table(rows: list[dict]) -> str:
    """Return the rows as a Markdown table, folded below a summary."""
    failed = [row for row in rows if not row["pass"]]
    count = f"{len(rows) - len(failed)} of {len(rows)} rows pass"
    cells = ["name", "quantity", "measured", "unit", "expected", "pass"]
    lines = [" | ".join(cells), " | ".join(["---"] * len(cells))]
    for row in rows:
        measured = "-" if row["measured"] is None else f"{row['measured']:.4g}"
        word = "yes" if row["pass"] else "**no**"
        shown = {**row, "measured": measured, "pass": word}
        lines.append(" | ".join(shown[cell] for cell in cells))
    text = "\n".join(f"| {line} |" for line in lines)
    unfolded = " open" if failed else ""
    return f"<details{unfolded}><summary>{count}</summary>\n\n{text}\n\n</details>\n"


def shrink(figure: Image.Image) -> bytes:
    """Return a figure as PNG with as many colours as `LARGEST` allows."""
    for colors in (256, 128, 64):
        file = io.BytesIO()
        few = figure.convert("RGB").quantize(colors, dither=Image.Dither.NONE)
        few.save(file, "PNG", optimize=True)
        if file.tell() < LARGEST:
            break
    return file.getvalue()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--keep", action="store_true", help="keep existing results")
    options = parser.parse_args()
    descriptions = {**list_experiments(), **list_measurements()}
    for name in options.names or descriptions:
        out = RESULTS / name
        if not (options.keep and (out / "result.json").exists()):
            run_experiment(name, out, progress=sys.stderr.isatty())
        rows = json.loads((out / "result.json").read_text())
        page = update(PAGE.read_text(), name, descriptions[name], rows)
        PAGE.write_text(page)
        FIGURES.mkdir(exist_ok=True)
        with Image.open(out / f"{name}.png") as figure:
            (FIGURES / f"{name}.png").write_bytes(shrink(figure))


if __name__ == "__main__":
    main()
