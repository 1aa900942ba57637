// Draws series over time, with a cursor that all plots share.

const MARGIN = { left: 44, right: 6, top: 6, bottom: 6 };  // pixels

class Plot {
  constructor(parent, panel, data, seek) {
    this.panel = panel;
    this.data = data;
    this.box = parent.appendChild(document.createElement("figure"));
    const caption = this.box.appendChild(document.createElement("figcaption"));
    caption.append(Object.assign(document.createElement("b"), { textContent: panel.label }));
    this.readings = panel.series.map(({ name }, i) => {
      const entry = caption.appendChild(document.createElement("span"));
      entry.className = `line color-${i % data.colors}`;
      entry.append(name, " ");
      return entry.appendChild(document.createElement("output"));
    });
    const area = this.box.appendChild(document.createElement("div"));
    area.className = "area";
    this.canvas = area.appendChild(document.createElement("canvas"));
    this.canvas.setAttribute("role", "img");
    const names = panel.series.map(({ name }) => name).filter(Boolean).join(", ");
    this.canvas.setAttribute("aria-label", `${panel.label} over time${names && `: ${names}`}`);
    this.cursor = area.appendChild(document.createElement("div"));
    this.cursor.className = "cursor";
    const finite = panel.series.flatMap(({ values }) => values.filter((x) => x !== null));
    const low = Math.min(...finite), high = Math.max(...finite);
    const pad = 0.08 * (high - low) || 0.5 * Math.abs(high) || 1;
    this.decimals = Math.min(Math.max(2 - Math.floor(Math.log10(high - low || 1)), 0), 6);
    [this.low, this.high] = finite.length ? [low - pad, high + pad] : [0, 1];
    const drag = (event) => event.buttons && seek(this.timeAt(event.offsetX));
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      drag(event);
    });
    this.canvas.addEventListener("pointermove", drag);
  }

  get inner() { return this.canvas.clientWidth - MARGIN.left - MARGIN.right; }
  x(time) { return MARGIN.left + this.inner * time / this.data.duration; }
  timeAt(x) { return (x - MARGIN.left) / this.inner * this.data.duration; }

  draw() {
    const ratio = window.devicePixelRatio || 1, { canvas, data, low, high } = this;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    Object.assign(canvas, { width: width * ratio, height: height * ratio });
    const pen = canvas.getContext("2d"), style = getComputedStyle(this.box);
    const color = (name) => style.getPropertyValue(name).trim();
    pen.scale(ratio, ratio);
    const y = (value) => height - MARGIN.bottom -
      (height - MARGIN.top - MARGIN.bottom) * (value - low) / (high - low);
    data.modes.forEach(({ time }, i) => {
      if (i % 2) return;
      const end = data.modes[i + 1]?.time ?? data.duration;
      pen.fillStyle = color("--band");
      pen.fillRect(this.x(time), 0, this.x(end) - this.x(time), height);
    });
    pen.font = `11px ${style.fontFamily}`;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const value of ticks(low, high)) {
      pen.strokeStyle = color("--grid");
      pen.beginPath();
      pen.moveTo(MARGIN.left, y(value));
      pen.lineTo(width - MARGIN.right, y(value));
      pen.stroke();
      pen.fillStyle = color("--quiet");
      pen.fillText(String(value), MARGIN.left - 5, y(value));
    }
    pen.lineWidth = 1.4;
    pen.lineJoin = "round";
    this.panel.series.forEach(({ values }, i) => {
      pen.strokeStyle = color(`--line-${i % data.colors}`);
      pen.beginPath();
      let down = false;
      values.forEach((value, k) => {
        if (value !== null) pen[down ? "lineTo" : "moveTo"](this.x(data.time[k]), y(value));
        down = value !== null;
      });
      pen.stroke();
    });
  }

  point(time, row) {
    this.cursor.style.transform = `translateX(${this.x(time)}px)`;
    this.readings.forEach((reading, i) => {
      const value = this.panel.series[i].values[row];
      const text = value === null ? "–" : value.toFixed(this.decimals).replace(/^-(0[.0]*)$/, "$1");
      if (reading.value !== text) reading.value = text;
    });
  }
}

// Two to five round numbers within an interval.
function ticks(low, high) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(Number((k * step).toPrecision(6)));
  return found;
}
