// The page: scene, plots, video and images at one time, and the controls that change it.

const find = (id) => document.getElementById(id);
const data = JSON.parse(find("data").textContent);
const player = { time: 0, playing: false, speed: 1 };

async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

const gltf = new Gltf(await unpack(find("glb").textContent));
const plots = data.panels.map((panel) => new Plot(find("plots"), panel, data, (t) => user.seek(t)));
// In a page with several runs, the user's controls act on all runs.
const led = Boolean(window.frameElement?.hasAttribute("data-led"));
const user = Object.fromEntries(["seek", "play"].map((name) => [name, (value) => {
  ((led && parent.conductor) || { seek, play })[name](value);
}]));
document.documentElement.classList.toggle("led", led);
const canvas = find("scene"), range = find("time"), video = find("video");
let view = null;
try {
  view = new View(canvas, gltf);
} catch (error) {
  find("lost").hidden = false;
  find("lost").textContent = `No 3D view: ${error.message}.`;
}

// The log's row and the planner's mode at a time.

function latest(times, time) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-6) low = middle + 1; else high = middle;
  }
  return Math.max(low - 1, 0);
}

const modeTimes = data.modes.map(({ time }) => time);
const modeAt = (time) => data.modes[latest(modeTimes, time)];
function chipsIn(id, entries) {
  return entries.map(({ time, mode }) => {
    const link = document.createElement("a");
    link.href = `#t=${time.toFixed(2)}`;
    link.textContent = mode;
    link.title = `from ${time.toFixed(2)} s`;
    link.addEventListener("click", (event) => {
      event.preventDefault();
      user.seek(time);
      user.play(false);
    });
    return find(id).appendChild(link);
  });
}
function mark(chips, current) {
  chips.forEach((chip, i) => {
    if (i === current) chip.setAttribute("aria-current", "true");
    else chip.removeAttribute("aria-current");
  });
}
const chips = chipsIn("modes", data.modes);
// With many modes, only those of the present cycle are shown.
const cycleTimes = data.cycles.map(({ time }) => time);
const cycleChips = chipsIn("cycles", data.cycles.map(({ time, label }) => ({ time, mode: label })));
const cycleOf = modeTimes.map((time) => latest(cycleTimes, time));

// Time.

function seek(time) {
  player.time = Math.min(Math.max(Number(time) || 0, 0), data.duration);
  show();
}

function show() {
  const { time } = player;
  gltf.pose(time);
  drawScene();
  const row = latest(data.time, time), mode = latest(modeTimes, time);
  for (const plot of plots) plot.point(time, row);
  range.value = time;
  range.setAttribute("aria-valuetext", `${time.toFixed(2)} s, ${data.modes[mode]?.mode ?? ""}`);
  find("clock").value = `${time.toFixed(2)} s`;
  find("mode").value = data.modes[mode]?.mode ?? "";
  const cycle = cycleOf[mode];
  mark(chips, mode);
  mark(cycleChips, cycle);
  chips.forEach((chip, i) => { chip.hidden = cycleOf[i] !== cycle; });
  showSight(time);
  if (video) {
    const wanted = Math.max(time - data.video_start, 0) + 0.001;  // 1 ms after the frame's start
    const near = player.playing ? 0.12 * player.speed : 0.002;
    if (Math.abs(video.currentTime - wanted) > near && !video.seeking) video.currentTime = wanted;
  }
}

function play(on) {
  if (on && player.time >= data.duration) player.time = 0;
  player.playing = on;
  find("play").setAttribute("aria-pressed", String(on));
  find("play").textContent = on ? "❚❚ Pause" : "▶ Play";
  if (video) {
    video.playbackRate = player.speed;
    if (on) video.play().catch(() => {}); else video.pause();
  }
  if (on) {
    let last = performance.now();
    const step = (now) => {
      if (!player.playing) return;
      seek(player.time + player.speed * (now - last) / 1000);
      last = now;
      if (player.time >= data.duration) play(false); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  } else {
    show();
    note();
  }
}

// Put the time into the address, so that a copied link opens the page at this time.
function note() {
  if (location.protocol !== "about:") history.replaceState(null, "", `#t=${player.time.toFixed(2)}`);
}

function follow() {
  const [, time] = /^#t=([\d.]+)$/.exec(location.hash) ?? [];
  if (time === undefined) return false;
  seek(time);
  play(false);
  return true;
}

// The planner's latest look: an image, with blobs if there is a localizer.

let sight = null;
function showSight(time) {
  const figure = find("sight");
  if (!figure) return;
  const next = data.sights.findLast((one) => one.time <= time + 1e-6) ?? data.sights[0];
  if (next === sight) return;
  sight = next;
  find("sight-image").src = next.image;
  find("sight-image").alt = `Image of the camera ${next.camera}`;
  const blobs = next.blobs ?? [];  // none at all without a localizer
  const said = blobs.map((blob) => `${blob.name} (quality ${blob.quality.toFixed(2)})`);
  const found = next.blobs ? `: ${said.join(", ") || "nothing found"}` : "";
  find("sight-words").textContent =
    `Camera ${next.camera} at ${next.time.toFixed(2)} s${found}`;
  find("blobs").replaceChildren(...blobs.map((blob) => {
    const mark = document.createElement("i");
    mark.style.left = `${100 * blob.at[0]}%`;
    mark.style.top = `${100 * blob.at[1]}%`;
    return mark;
  }));
}

// The pointer turns, moves and zooms the scene.

function drawScene() {
  if (!view) return;
  const [r, g, b] = getComputedStyle(canvas).backgroundColor.match(/[\d.]+/g).map(Number);
  view.draw([r / 255, g / 255, b / 255]);
}

const pointers = new Map();
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("pointerdown", (event) => {
  pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  canvas.setPointerCapture(event.pointerId);
});
for (const name of ["pointerup", "pointercancel"]) {
  canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
}
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before || !view) return;
  const [x, y] = [event.offsetX - before[0], event.offsetY - before[1]];
  const height = canvas.clientHeight, moving = event.shiftKey || event.buttons & 6;
  if (pointers.size > 1) {
    const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) + 1;
    view.zoom(apart(before) / apart([event.offsetX, event.offsetY]));
    view.pan(0.5 * x / height, -0.5 * y / height);
  } else if (moving) view.pan(x / height, -y / height);
  else view.turn(4 * x / height, 4 * y / height);
  pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
  drawScene();
});
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  view?.zoom(Math.exp(0.001 * event.deltaY));
  drawScene();
}, { passive: false });

// Controls.

function reset() { view?.reset(); drawScene(); }
function toggle(name) {
  find(name).checked = !find(name).checked;
  find(name).dispatchEvent(new Event("change"));
}
for (const name of ["forces", "cameras"]) {
  find(name).addEventListener("change", () => {
    if (view) view.show[name] = find(name).checked;
    drawScene();
  });
}
range.addEventListener("input", () => user.seek(range.value));
range.addEventListener("change", note);
find("play").addEventListener("click", () => user.play(!player.playing));
find("reset").addEventListener("click", reset);
function run(speed) {
  player.speed = speed;
  if (video) video.playbackRate = speed;
}
find("speed").addEventListener("change", () => run(Number(find("speed").value)));
const KEYS = {
  " ": () => user.play(!player.playing),
  ArrowLeft: (event) => user.seek(player.time - (event.shiftKey ? 1 : 0.1)),
  ArrowRight: (event) => user.seek(player.time + (event.shiftKey ? 1 : 0.1)),
  ",": () => user.seek(player.time - data.period),
  ".": () => user.seek(player.time + data.period),
  Home: () => user.seek(0),
  End: () => user.seek(data.duration),
  f: () => toggle("forces"),
  c: () => toggle("cameras"),
  r: reset,
  "+": () => { view?.zoom(0.8); drawScene(); },
  "-": () => { view?.zoom(1.25); drawScene(); },
};
document.addEventListener("keydown", (event) => {
  const action = KEYS[event.key];
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  // A focused control handles its own keys.
  if (event.target.matches("select, input, summary")) return;
  if (event.key === " " && event.target.matches("button")) return;
  event.preventDefault();
  action(event);
});
window.addEventListener("hashchange", follow);
const redraw = () => { plots.forEach((plot) => plot.draw()); show(); };
new ResizeObserver(redraw).observe(document.body);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
redraw();
if (!led && !follow() && !matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);

// For scripts and tests.
window.replay = {
  duration: data.duration, seek, play, run, view,
  get time() { return player.time; },
  get mode() { return modeAt(player.time)?.mode ?? ""; },
  names: gltf.nodes.map((node) => node.name),
  // [x, y, z, qx, qy, qz, qw] of a node at the present time [m].
  pose(name) {
    const node = gltf.nodes.find((one) => one.name === name);
    return [...node.translation, ...node.rotation];
  },
};
