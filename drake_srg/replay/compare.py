"""Writes a page that plays several runs side by side, on one timeline."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from drake_srg.recording.output import OutputFile
from drake_srg.replay.page import page_html, page_script, page_style, policy, text_of


def write_comparison(folders: Sequence[Path], path: Path) -> Path:
    """Write a page with the replays of several recorded runs.

    Args:
        folders: Folders of the runs; see `write_page`.
        path: The page to write.

    Returns:
        The path.

    Raises:
        ScenarioError: If a file is missing or cannot be read.
        OSError: If the page cannot be written.
    """
    pages = [page_html(folder) for folder in folders]
    script = text_of("compare.js")
    style = page_style() + text_of("compare.css")
    title = " and ".join(folder.name or str(folder) for folder in folders)
    names = [html.escape(str(folder)) for folder in folders]
    frames = [
        f'<iframe data-led title="{name}" srcdoc="{html.escape(page)}"></iframe>'
        for name, page in zip(names, pages, strict=True)
    ]
    output = OutputFile(path)
    output.path.write_text(
        text_of("compare.html").format(
            # The frames inherit this policy.
            policy=policy([script, page_script()], [style, page_style()]),
            title=html.escape(title),
            style=style,
            frames="".join(frames),
            script=script,
        ),
        encoding="utf-8",
    )
    return output.commit()
