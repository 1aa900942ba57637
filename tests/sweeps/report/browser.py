"""A report as a browser renders it."""

_LOOK = """(() => {
  const boxes = [...document.body.querySelectorAll("*")].filter(
    (e) => !e.closest(".scroll, pre, svg") &&
      e.getBoundingClientRect().right > window.innerWidth + 0.5);
  return {
    title: document.title,
    width: window.innerWidth,
    scroll_width: document.documentElement.scrollWidth,
    sticking_out: boxes.map((e) => e.outerHTML.slice(0, 80)),
    headings: [...document.querySelectorAll("h1, h2")].map((e) => e.textContent),
    scripts: document.scripts.length,
    unnamed: [...document.querySelectorAll("svg, video, [role=region]")]
      .filter((e) => !e.getAttribute("aria-label")).length,
    text: document.body.innerText,
  };
})()"""

# The shade in the middle of the frame that a video shows.
_SHADE = """(() => {
  const canvas = document.createElement("canvas").getContext("2d");
  canvas.drawImage(%s, 0, 0);
  return canvas.getImageData(80, 60, 1, 1).data[0];
})()"""


def open_page(browser, path, width=1400):
    """Open a file in a window `width` pixels wide, and wait until it is loaded."""
    loaded = "location.protocol === 'file:' && document.readyState === 'complete'"
    browser.open(path.as_uri(), width, ready=loaded)


def look(browser, path, width=1400):
    """Open a file in a window `width` pixels wide, and return what is in it."""
    open_page(browser, path, width)
    return browser.evaluate(_LOOK) | {
        "complaints": browser.complaints(),
        "loaded": [url for url in browser.requests() if url != path.as_uri()],
    }


def wait_for_shade(browser, video, time, shade, within):
    """Seek a video without playing it, and wait until it shows a shade."""
    browser.evaluate(f"void ({video}.currentTime = {time})")
    browser.wait_for(f"Math.abs({_SHADE % video} - {shade}) <= {within}")
