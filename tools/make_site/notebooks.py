"""Notebooks as pages, with their saved outputs: nothing is executed."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def notebook_page(path: Path, images: Path) -> str:
    """Return a notebook as Markdown, and write its pictures beside the page.

    Args:
        path: Path of the notebook with its outputs.
        images: Folder for the pictures, beside the page.
    """
    parts: list[str] = []
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        if cell["cell_type"] == "markdown":
            parts.append(_text(cell["source"]))
            continue
        parts.append(f"```python\n{_text(cell['source'])}\n```")
        for output in cell["outputs"]:
            stem = f"{path.stem}_{len(parts)}"
            parts.append(_output(output.get("data", output), images, stem))
    return "\n\n".join(filter(None, parts)) + "\n"


def _output(data: Mapping[str, Any], images: Path, stem: str) -> str:
    """Return an output of a cell as Markdown."""
    if "image/png" in data:
        images.mkdir(parents=True, exist_ok=True)
        picture = images / f"{stem}.png"
        picture.write_bytes(base64.b64decode(_text(data["image/png"])))
        return f"![]({images.name}/{picture.name})"
    if "text/html" in data:
        # A blank line would end the block of HTML.
        return re.sub(r"\n\s*\n", "\n", _text(data["text/html"]))
    text = _text(data.get("text/plain", data.get("text", ""))).rstrip()
    return f"```text\n{text}\n```" if text else ""


def _text(value: str | list[str]) -> str:
    """Return a notebook's text, which may be saved as its lines."""
    return value if isinstance(value, str) else "".join(value)
