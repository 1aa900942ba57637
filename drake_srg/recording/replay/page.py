"""The page replay.html: scene, plots, video and images of a run, or of several."""

from __future__ import annotations

import base64
import dataclasses as dc
import gzip
import hashlib
import html
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from drake_srg.common.exceptions import ScenarioError, one_line
from drake_srg.recording.output import OutputFile, read_log, verdict
from drake_srg.recording.replay.glb import EXTRAS, Json, read_glb
from drake_srg.recording.timeline import (
    COLORS,
    Labels,
    Timeline,
    mode_bands,
    mode_changes,
    run_timeline,
)


@dc.dataclass(frozen=True)
class RecordedRun:
    """A recorded run.

    Attributes:
        glb: The file replay.glb.
        labels: The run's title, and names for its log.
        timeline: Modes and plots of its log.
        sights: The planner's looks, each with `time` [s], `camera`, `image` (an index
            of `images`) and, if there is a localizer, `blobs`.
        images: JPEG files.
        video: Path of video.mp4; None if there is no video.
        video_start: Simulated time of its first frame [s].
    """

    glb: bytes
    labels: Labels
    timeline: Timeline
    sights: Sequence[Json]
    images: Sequence[bytes]
    video: Path | None
    video_start: float


def read_run(folder: Path) -> RecordedRun:
    """Read replay.glb and log.npz, and find video.mp4.

    Raises:
        ScenarioError: If a file is missing or cannot be read.
    """
    glb = _read(folder, "replay.glb")
    try:
        document, binary = read_glb(glb)
        extras = document["scenes"][0]["extras"][EXTRAS]
        labels = Labels.of_tree(extras["labels"])
        images = _images(document, binary)
        sights = list(extras["sights"])
        for sight in sights:
            images[sight["image"]]  # raises if it is missing
        video_start = float(extras["video_start"])
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise ScenarioError(
            f"{folder / 'replay.glb'}: not the scene of a recorded run: "
            f"{one_line(error)}"
        ) from error
    _read(folder, "log.npz")
    try:
        timeline = run_timeline(read_log(folder / "log.npz"), labels)
    except (ValueError, KeyError, OSError) as error:
        raise ScenarioError(
            f"{folder / 'log.npz'}: not the log of a run: {one_line(error)}"
        ) from error
    video = folder / "video.mp4"
    return RecordedRun(
        glb=glb,
        labels=labels,
        timeline=timeline,
        sights=sights,
        images=images,
        video=video if video.is_file() else None,
        video_start=video_start,
    )


def _read(folder: Path, name: str) -> bytes:
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        raise ScenarioError(
            f"{folder / name}: {error.strerror or error} "
            "(allowed: the folder of a run recorded without --no-record)"
        ) from error


def _images(document: Json, binary: bytes) -> list[bytes]:
    """Return the JPEG files in a GLB file."""
    views = (
        document["bufferViews"][i["bufferView"]] for i in document.get("images", [])
    )
    return [binary[view["byteOffset"] :][: view["byteLength"]] for view in views]


_SCRIPTS = ("gltf.js", "view.js", "plots.js", "page.js")
_DIGITS = 4  # significant digits of plotted values
_ON_DARK = {"#333333": "#f0f3f6", "#0072b2": "#8c8cff", "#d55e00": "#ff6b2b"}


def write_page(folder: Path) -> Path:
    """Write replay.html into a folder with the recording of a run.

    It needs replay.glb and log.npz, and also shows video.mp4 and the result in
    metrics.json if they exist.

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
    """Return a content security policy that allows these texts, escaped for HTML."""

    def hashes(texts: Sequence[str]) -> str:
        return " ".join(f"'sha256-{_sha256(text)}'" for text in texts)

    rules = ["default-src 'none'", f"script-src {hashes(scripts)}"]
    rules += [f"style-src {hashes(styles)}", "img-src data:", "media-src data:"]
    return html.escape("; ".join(rules))


def _result(path: Path) -> tuple[bool, str] | None:
    """Return whether a run succeeded, and its verdict; None if that is unknown."""
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
        success, word = bool(metrics["success"]), verdict(metrics)
        drawn = dict(metrics.get("kinds", {})).items()
        # The scene's nodes have names, such as clutter_1. The seed drew their kinds.
        named = ", ".join(f"{name} is {kind}" for name, kind in drawn)
        return success, f"{word}; {named}" if named else word
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _data_url(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _data(timeline: Timeline, sights: list[Json], video_start: float) -> Json:
    """Return the data for the page's scripts, without the scene and the video."""
    time, mode = timeline.time, timeline.mode
    changes = mode_changes(mode)
    bands = mode_bands(mode)
    return {
        "duration": _short(time[-1]),
        "period": _short(time[1] - time[0]) if len(time) > 1 else 0.02,
        "time": [_short(t, 6) for t in time],
        "colors": len(COLORS),
        "modes": [
            {"time": _short(time[i], 6), "mode": mode[i].replace("_", " ")}
            for i in changes
        ],
        # Empty unless there are too many modes to show at once.
        "cycles": [
            {"time": _short(time[i], 6), "label": label or "start"}
            for i, label in bands
            if len(bands) < len(changes)
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
            for label, values, names in timeline.panels
        ],
        "video_start": video_start,
        "sights": sights,
    }


def _short(value: float, digits: int = _DIGITS) -> float | None:
    """Return a number with fewer digits; None if it is not finite."""
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
        # A script element ends at the first "</script", even inside a string.
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
    return (resources.files("drake_srg.recording.replay") / name).read_text(
        encoding="utf-8"
    )


def _sha256(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def write_comparison(folders: Sequence[Path], path: Path) -> Path:
    """Write a page with the replays of several recorded runs; see `write_page`.

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
