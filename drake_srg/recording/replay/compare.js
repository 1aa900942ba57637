// One timeline for several pages of replays.

const find = (id) => document.getElementById(id);
const range = find("time");
const nextFrame = () => new Promise((done) => requestAnimationFrame(done));

async function loaded(frame) {
  while (!frame.contentWindow?.replay) await nextFrame();
  return frame.contentWindow.replay;
}
const runs = await Promise.all([...document.querySelectorAll("iframe")].map(loaded));
const duration = Math.max(...runs.map((run) => run.duration));
let playing = false, shown = 0;

function show(time) {
  shown = range.value = time;
  find("clock").value = `${time.toFixed(2)} s`;
  range.setAttribute("aria-valuetext", find("clock").value);
}

function seek(time) {
  time = Math.min(Math.max(Number(time) || 0, 0), duration);
  for (const run of runs) run.seek(time);
  show(time);
}

function play(on) {
  if (on && shown >= duration) seek(0);
  playing = on;
  find("play").setAttribute("aria-pressed", String(on));
  find("play").textContent = on ? "❚❚ Pause" : "▶ Play";
  // Runs that have ended stay there: `play` would start them again.
  for (const run of runs) run.play(on && run.time < run.duration);
  if (on) follow();
  else history.replaceState(null, "", `#t=${shown.toFixed(2)}`);
}

async function follow() {
  while (playing) {
    show(Math.max(...runs.map((run) => run.time)));
    if (shown >= duration) {
      play(false);
      seek(duration); // other runs may be a frame behind
    }
    await nextFrame();
  }
}

function open() {
  const [, time] = /^#t=([\d.]+)$/.exec(location.hash) ?? [];
  if (time === undefined) return false;
  play(false);
  seek(time);
  return true;
}

range.addEventListener("input", () => seek(range.value));
find("play").addEventListener("click", () => play(!playing));
find("speed").addEventListener("change", () => {
  for (const run of runs) run.run(Number(find("speed").value));
});
const KEYS = {
  " ": () => play(!playing),
  ArrowLeft: (event) => seek(shown - (event.shiftKey ? 1 : 0.1)),
  ArrowRight: (event) => seek(shown + (event.shiftKey ? 1 : 0.1)),
  Home: () => seek(0),
  End: () => seek(duration),
};
document.addEventListener("keydown", (event) => {
  const action = KEYS[event.key];
  if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.matches("select, input, button")) return;
  event.preventDefault();
  action(event);
});
window.addEventListener("hashchange", open);
range.max = duration;
window.conductor = { seek, play };
if (!open() && !matchMedia("(prefers-reduced-motion: reduce)").matches) play(true);

// For scripts and tests.
window.replay = { duration, runs, seek, play, get time() { return shown; } };
