"""Writes replay.html: one page with scene, plots, video and images of a run."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import itertools
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from drake_srg.recording.figure import COLORS
from drake_srg.recording.output import OutputFile
from drake_srg.recording.timeline import Timeline, timeline_panels
from drake_srg.replay.glb import Json
from drake_srg.replay.recorded import read_run

_SCRIPTS = ("gltf.js", "view.js", "plots.js", "page.js")
_DIGITS = 4  # significant digits of plotted values
_ON_DARK = {"#333333": "#c8ced6", "#0072b2": "#4aa8e0"}


def write_page(folder: Path) -> Path:
    """Write replay.html into a folder with the recording of a run.

    It needs replay.glb and log.npz, and shows video.mp4 and the result in metrics.json
    where they exist.

    Returns:
        The path of the page.

    Raises:
        ScenarioError: If a file is missing or cannot be read.
        OSError: If the page cannot be written.
    """
    text = page_html(folder)
    output = OutputFile(folder / "replay.html")
    output.path.write_text(text, encoding="utf-8")
    return output.commit()


def page_html(folder: Path) -> str:
    """Return the text of `write_page`.

    Raises:
        ScenarioError: If a file is missing or cannot be read.
    """
    run = read_run(folder)
    images = [_data_url("image/jpeg", image) for image in run.images]
    sights = [{**sight, "image": images[sight["image"]]} for sight in run.sights]
    return _page(
        run.labels.title,
        _result(folder / "metrics.json"),
        _data(run.timeline, sights, run.video_start),
        run.glb,
        None if run.video is None else run.video.read_bytes(),
    )


def page_script() -> str:
    """Return the script of every page."""
    return "\n".join(text_of(name) for name in _SCRIPTS)


def page_style() -> str:
    """Return the style sheet of every page."""
    return text_of("page.css") + _line_colors()


def policy(scripts: Sequence[str], styles: Sequence[str]) -> str:
    """Return, as an HTML attribute, a policy that allows these texts and no request."""

    def hashes(texts: Sequence[str]) -> str:
        return " ".join(f"'sha256-{_sha256(text)}'" for text in texts)

    rules = ["default-src 'none'", f"script-src {hashes(scripts)}"]
    rules += [f"style-src {hashes(styles)}", "img-src data:", "media-src data:"]
    return html.escape("; ".join(rules))


def _result(path: Path) -> tuple[bool, str] | None:
    """Return whether a run succeeded and a phrase about it, if metrics.json tells."""
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
        success, tries = bool(metrics["success"]), int(metrics["attempts"])
        word = "success" if success else f"failure: {metrics['failure']}"
        if "objects_total" in metrics:
            word += f", {metrics['objects_cleared']} of {metrics['objects_total']}"
            return success, f"{word} objects cleared, {tries} picks"
        return success, f"{word}, {tries} attempt{'' if tries == 1 else 's'}"
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _data_url(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _data(timeline: Timeline, sights: list[Json], video_start: float) -> Json:
    """Return what the page's scripts show, besides the scene and the video."""
    time = timeline.time
    changes = [0, *(1 + np.flatnonzero(_differ(timeline.mode)))]
    return {
        "duration": _short(time[-1]),
        "period": _short(time[1] - time[0]) if len(time) > 1 else 0.02,
        "time": [_short(t, 6) for t in time],
        "colors": len(COLORS),
        "modes": [
            {"time": _short(time[i], 6), "mode": timeline.mode[i].replace("_", " ")}
            for i in changes
        ],
        "panels": [
            {
                "label": label.replace("\n", " "),
                "series": [
                    {
                        "name": names[i] if i < len(names) else "",
                        "values": [_short(x) for x in values[:, i]],
                    }
                    for i in range(values.shape[1])
                ],
            }
            for label, values, names in timeline_panels(timeline)
        ],
        "video_start": video_start,
        "sights": sights,
    }


def _differ(words: Sequence[str]) -> list[bool]:
    return [a != b for a, b in itertools.pairwise(words)]


def _short(value: float, digits: int = _DIGITS) -> float | None:
    """Return a number without needless digits; None if it is not finite."""
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None


def _page(
    title: str,
    result: tuple[bool, str] | None,
    data: Json,
    glb: bytes,
    video: bytes | None,
) -> str:
    script, style = page_script(), page_style()
    said = ""
    if result is not None:
        kind = "good" if result[0] else "bad"
        said = f'<p class="{kind}">{html.escape(result[1])}</p>'
    packed = base64.b64encode(gzip.compress(glb, 9, mtime=0)).decode()
    return text_of("page.html").format(
        policy=policy([script], [style]),
        title=html.escape(title),
        style=style,
        result=said,
        duration=data["duration"],
        period=data["period"],
        pictures=_pictures(data, video),
        # A script element ends at the first "</script", wherever it is.
        data=json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
        glb=packed,
        script=script,
    )


def _pictures(data: Json, video: bytes | None) -> str:
    parts = []
    if video is not None:
        parts.append(
            '<figure><video id="video" muted playsinline preload="auto" '
            f'aria-label="Recorded video" src="{_data_url("video/mp4", video)}">'
            "</video><figcaption>Recorded video</figcaption></figure>"
        )
    if data["sights"]:
        parts.append(
            '<figure id="sight"><div class="seen"><img id="sight-image" alt="">'
            '<div id="blobs"></div></div><figcaption id="sight-words"></figcaption>'
            "</figure>"
        )
    return f'<div class="pictures">{"".join(parts)}</div>' if parts else ""


def _line_colors() -> str:
    """Return CSS for the lines of plots, with paler colours on a dark page."""

    def variables(colors: Sequence[str]) -> str:
        return "".join(f"--line-{i}:{color};" for i, color in enumerate(colors))

    dark = [_ON_DARK.get(color, color) for color in COLORS]
    rules = [
        f":root{{{variables(COLORS)}}}",
        f"@media (prefers-color-scheme: dark){{:root{{{variables(dark)}}}}}",
        *(f".color-{i}{{--line:var(--line-{i})}}" for i in range(len(COLORS))),
    ]
    return "\n".join([*rules, ""])


def text_of(name: str) -> str:
    """Return a text file of this package."""
    return (resources.files("drake_srg.replay") / name).read_text(encoding="utf-8")


def _sha256(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
