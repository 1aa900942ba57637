"""Opens pages in Chromium without a screen, and returns what it makes of them."""

import html
import json
import re
import subprocess

from helpers import needs_debian

# Shows the page in a frame of the given width (Chromium's window cannot be as narrow as
# a phone), and stores what it finds in an attribute.
_HARNESS = """<!DOCTYPE html><html><body style="margin:0">
<iframe srcdoc="{page}" style="border:0;width:{width}px;height:900px"></iframe>
<script>
const frame = document.querySelector("iframe");
function tell() {{
  const page = frame.contentDocument, window = frame.contentWindow;
  const boxes = [...page.body.querySelectorAll("*")].filter(
    (e) => !e.closest(".scroll, pre, svg") &&
      e.getBoundingClientRect().right > window.innerWidth + 0.5);
  document.body.dataset.told = JSON.stringify({{
    title: page.title,
    width: window.innerWidth,
    scroll_width: page.documentElement.scrollWidth,
    sticking_out: boxes.map((e) => e.outerHTML.slice(0, 80)),
    headings: [...page.querySelectorAll("h1, h2")].map((e) => e.textContent),
    scripts: page.scripts.length,
    loaded: window.performance.getEntriesByType("resource").map((e) => e.name)
      .filter((name) => !name.startsWith("data:")),
    unnamed: [...page.querySelectorAll("svg, video, [role=region]")]
      .filter((e) => !e.getAttribute("aria-label")).length,
    videos: [...page.querySelectorAll("video")]
      .map((e) => [e.videoWidth, e.videoHeight, e.duration, e.controls,
                   JSON.parse(e.dataset.shades || "[]")]),
    text: page.body.innerText,
  }});
}}
// Seeks frames, which decodes them without playing the video, and stores their colours.
function seek(video) {{
  const shades = [];
  const next = (time) => new Promise((done) => {{
    video.onseeked = () => {{
      const canvas = document.createElement("canvas").getContext("2d");
      canvas.drawImage(video, 0, 0);
      shades.push([video.currentTime, canvas.getImageData(80, 60, 1, 1).data[0]]);
      done();
    }};
    video.currentTime = time;
  }});
  next(0.125).then(() => next(0.425))
    .then(() => video.dataset.shades = JSON.stringify(shades));
}}
frame.onload = () => {{
  frame.contentDocument.querySelectorAll("video").forEach(seek);
  setTimeout(tell, 2000);
}};
</script></body></html>"""


class Browser:
    """Chromium with its profile in a folder."""

    def __init__(self, folder):
        needs_debian("chromium")
        self._folder = folder

    def open(self, page, width=1400):
        """Return what Chromium finds in a page (HTML) that is `width` pixels wide."""
        harness = self._folder / "harness.html"
        harness.write_text(
            _HARNESS.format(page=html.escape(page), width=width), encoding="utf-8"
        )
        # Virtual time passes quickly while there is nothing to do.
        shown = self._run("--virtual-time-budget=8000", "--dump-dom", harness.as_uri())
        told = json.loads(
            html.unescape(re.search(r'data-told="([^"]*)"', shown.stdout)[1])
        )
        return told | {
            "console": [line for line in shown.stderr.splitlines() if "CONSOLE" in line]
        }

    def _run(self, *arguments):
        return subprocess.run(
            [
                *("chromium", "--headless", "--no-sandbox", "--disable-gpu"),
                *("--hide-scrollbars", "--enable-logging=stderr"),
                *("--window-size=1400,900", f"--user-data-dir={self._folder}/profile"),
                *arguments,
            ],
            capture_output=True,
            text=True,
            timeout=60.0,
            check=True,
        )
