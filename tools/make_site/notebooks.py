"""Notebooks as pages: what they show is saved in them, so nothing is executed."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import Any

import nbformat


def notebook_page(path: Path, images: Path) -> str:
    """Return a notebook as Markdown, and write its pictures beside the page.

    Args:
        path: Of the notebook, with its outputs.
        images: Folder for the pictures, beside the page.
    """
    parts: list[str] = []
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.get("outputs", []):
            stem = f"{path.stem}_{len(parts)}"
            parts.append(_output(output.get("data", output), images, stem))
    return "\n\n".join(filter(None, parts)) + "\n"


def _output(data: Any, images: Path, stem: str) -> str:
    """Return an output of a cell as Markdown."""
    if "image/png" in data:
        images.mkdir(parents=True, exist_ok=True)
        picture = images / f"{stem}.png"
        picture.write_bytes(base64.b64decode(data["image/png"]))
        return f"![]({images.name}/{picture.name})"
    if "text/html" in data:
        return re.sub(r"\n\s*\n", "\n", str(data["text/html"]))  # one block of HTML
    text = data.get("text/plain", data.get("text", ""))
    return f"```text\n{text.rstrip()}\n```" if text.strip() else ""
