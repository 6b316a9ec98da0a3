"use strict";
// Plots by uPlot: drag to zoom, double-click to reset, hover to read, legend to hide.
// Every plot over time shares one range and one cursor, so that all show the same moment.

const DASHES = [[], [7, 4], [2, 3], [10, 3, 2, 3]];
const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';

// window: what linked plots show while nobody has zoomed; dragging: a pointer is down on a plot;
// events: modes and fault codes; marks: the two cursors; sent: instants of commands, by colour
const shared = {
  range: null, window: null, cursor: null, dragging: false, plots: [], listeners: [], zoomed: [],
  events: [], marks: [], sent: [],
};

function setCursor(x, source = null) {
  shared.cursor = x;
  for (const plot of shared.plots) if (plot.spec.linked) plot.follow(x, plot !== source);
  for (const listener of shared.listeners) listener(x, source);
}

function setRange(range) {
  shared.range = range;
  drawAll(shared.plots.filter((plot) => plot.spec.linked));
  for (const listener of shared.zoomed) listener(range);
}

// sizes first: drawing changes the page, which would be laid out anew for each
function drawAll(plots = shared.plots) {
  const sizes = plots.map((plot) => plot.size());
  plots.forEach((plot, place) => plot.draw(sizes[place]));
}

function tickLabels(u, values, axis, space, step) {
  let digits = 0;
  while (digits < 12 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits++;
  return values.map((value) => (value === null ? "" : value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1")));
}

// kinds that are drawn on the canvas by us, as uPlot joins points of rising x alone
const DRAWN = new Set(["marks", "spans", "map", "points"]);

class Plot {
  constructor(figure, spec) {
    this.figure = figure;
    this.spec = spec;
    this.range = null;
    this.full = null;
    this.yRange = null;
    this.series = spec.series.map((s) => {
      const [x, y] = [s.x, s.y].map((v) => (typeof v === "string" ? decode(v) : v));
      return { ...s, x, y, shown: true, kind: spec.equal && s.kind === "line" ? "map" : s.kind };
    });
    const caption = tag("figcaption", "", figure);
    tag("h3", "", caption, spec.title);
    pushButton(caption, "reset zoom", () => this.zoom(null, null)).className = "reset";
    if (spec.note) tag("p", "", figure, spec.note);
    this.joined = this.series.filter((series) => !DRAWN.has(series.kind));
    this.u = new uPlot(this.options(), this.data(), figure);
    this.u.root.setAttribute("role", "img");
    this.u.root.setAttribute("aria-label", spec.title);
    this.legend(tag("div", "legend", figure));
    this.touch();
    shared.plots.push(this);
  }

  size() {
    const width = Math.max(this.figure.clientWidth - 26, 200);
    const rows = this.spec.levels.length;
    if (this.spec.height) return { width, height: this.spec.height };
    if (this.spec.equal) return { width, height: Math.min(300, width * 0.6) };
    return { width, height: Math.max(Math.min(250, width * 0.62), rows ? 16 * rows + 44 : 0) };
  }

  options() {
    const { levels, linked, equal, xlabel, ylabel } = this.spec;
    const axis = {
      font: FONT, labelFont: FONT, labelGap: 0, stroke: () => ink("--soft"), ticks: { show: false },
      grid: { stroke: () => ink("--line"), width: 1 }, values: tickLabels,
    };
    const wide = (u, texts) => 14 + 7.2 * Math.max(3, ...(texts ?? []).map((text) => String(text).length));
    const named = { splits: () => levels.map((_, place) => place), values: () => levels };
    const line = (series) => ({
      stroke: () => ink(`--c${series.colour % 8}`), width: 1.7, dash: DASHES[series.dash || 0],
      points: { show: false },
      fill: series.kind === "bars" ? () => `${ink(`--c${series.colour % 8}`)}55` : undefined,
      paths: series.kind === "line" ? uPlot.paths.linear() : uPlot.paths.stepped({ align: 1 }),
    });
    return {
      ...this.size(),
      legend: { show: false },
      scales: {
        x: { time: false, range: () => this.xRange() },
        y: { range: (u, low, high) => this.valueRange(low, high), dir: levels.length ? -1 : 1 },
      },
      axes: [
        { ...axis, label: xlabel, labelSize: xlabel ? 16 : 0, size: 22 },
        {
          ...axis, label: levels.length ? "" : ylabel, labelSize: levels.length || !ylabel ? 0 : 18,
          space: this.spec.margin ? 16 : 30, size: this.spec.margin ?? wide, ...(levels.length ? named : {}),
        },
      ],
      series: [{}, ...this.joined.map(line)],
      cursor: {
        points: { show: false }, y: Boolean(equal), drag: { x: true, y: Boolean(equal), setScale: false, dist: 6 },
        bind: {
          dblclick: () => () => this.zoom(null, null),
          mousedown: (u, over, act) => (event) => {
            if (event.button !== 0) return;
            shared.dragging = true;
            act(event);
          },
          mouseup: (u, over, act) => (event) => {
            shared.dragging = false;
            act(event);
          },
        },
      },
      hooks: {
        setSelect: [(u) => this.select(u)],
        setCursor: [(u) => this.hover(u)],
        drawAxes: [(u) => this.drawBelow(u)],
        draw: [(u) => this.drawAbove(u)],
      },
    };
  }

  // one rising x for all curves; where a curve has no point of that x, its line goes on
  data() {
    const tables = this.joined.map(({ x, y, kind, width }) => {
      const ends = kind === "bars" && x.length ? [[x[x.length - 1] + width], [0]] : [[], []];
      const values = Array.from(y, (value) => (Number.isFinite(value) ? value : null));
      return [[...x, ...ends[0]], [...values, ...ends[1]]];
    });
    if (!tables.length) return [this.xRange()];
    return tables.length === 1 ? tables[0] : uPlot.join(tables);
  }

  draw({ width, height } = this.size()) {
    const [min, max] = this.xRange();
    this.figure.classList.toggle("zoomed", Boolean((this.spec.linked ? shared.range : this.range) || this.yRange));
    this.figure.dataset.points = String(this.pointsShown(min, max));
    this.u.batch(() => {
      if (width !== this.u.width || height !== this.u.height) this.u.setSize({ width, height });
      this.u.setScale("x", { min, max });
    });
    if (this.spec.linked) this.follow(shared.cursor, true);
  }

  pointsShown(low, high) {
    let points = 0;
    for (const { x, end, kind, shown } of this.series) {
      const ends = kind === "spans" ? end : x;
      if (shown) for (let i = 0; i < x.length; i++) points += ends[i] >= low && x[i] <= high;
    }
    return points;
  }

  xRange() {
    const chosen = this.spec.linked ? shared.range || shared.window : this.range;
    if (chosen) return chosen;
    this.full ??= this.fullRange();
    return this.full;
  }

  fullRange() {
    let [low, high] = [Infinity, -Infinity];
    for (const { x, kind, width, shown } of this.series) {
      if (!shown) continue;
      for (const value of x) {
        low = Math.min(low, value);
        high = Math.max(high, value + (kind === "bars" ? width : 0));
      }
    }
    if (high > low) {
      const pad = this.series.some(({ kind }) => kind === "points") ? (high - low) * 0.03 : 0;
      return [low - pad, high + pad];
    }
    return Number.isFinite(low) ? [low - 0.5, low + 0.5] : [0, 1];
  }

  // low and high: of what uPlot draws in the range shown; null if nothing
  valueRange(low, high) {
    const { levels, zero } = this.spec;
    if (levels.length) return [-0.5, levels.length - 0.5];
    if (this.yRange) return this.yRange;
    let bottom = Math.min(low ?? Infinity, zero ? 0 : Infinity);
    let top = Math.max(high ?? -Infinity, zero ? 0 : -Infinity);
    const [left, right] = this.xRange();
    for (const { x, y, kind, shown } of this.series) {
      if (!shown || (kind !== "map" && kind !== "points")) continue;
      for (let i = 0; i < x.length; i++) {
        if (x[i] < left || x[i] > right || !Number.isFinite(y[i])) continue;
        bottom = Math.min(bottom, y[i]);
        top = Math.max(top, y[i]);
      }
    }
    if (!(top >= bottom)) return [0, 1];
    const pad = (top - bottom || Math.abs(top) || 1) * 0.06;
    // a strip has names above its curves and marks below
    if (this.spec.named) return [bottom - 3 * pad, top + 2.5 * pad];
    return [bottom === 0 && zero ? 0 : bottom - pad, top + pad];
  }

  zoom(xr, yr) {
    this.yRange = yr;
    if (this.spec.linked) setRange(xr);
    else {
      this.range = xr;
      this.draw();
    }
  }

  select(u) {
    const { left, top, width, height } = u.select;
    if (width < 6) return;
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    const xr = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
    const yr = [u.posToVal(top + height, "y"), u.posToVal(top, "y")];
    this.zoom(xr, this.spec.equal && yr[1] > yr[0] ? yr : null);
  }

  hover(u) {
    const inside = u.cursor.left >= 0;
    this.pointer = inside ? u.cursor.left : null;
    const x = inside ? u.posToVal(u.cursor.left, "x") : null;
    if (!this.spec.linked) this.speak(x, inside ? u.posToVal(u.cursor.top, "y") : null);
    else if (inside) setCursor(x, this);
  }

  // the cursor of another plot, or of the playback
  follow(x, move) {
    if (move) {
      const left = x === null ? -10 : this.u.valToPos(x, "x");
      const seen = left >= 0 && left <= this.u.over.clientWidth;
      this.u.setCursor({ left: seen ? left : -10, top: seen ? 0 : -10 }, false);
    }
    this.speak(x, null);
  }

  remove() {
    shared.plots.splice(shared.plots.indexOf(this), 1);
    this.u.destroy();
    this.figure.remove();
  }

  numberAt({ x, y, kind }, t) {
    if (t === null || !x.length || t < x[0] - 1e-3) return NaN;
    return y[kind === "step" || kind === "bars" ? before(x, t) : nearest(x, t)];
  }

  valueAt(series, x) {
    if (x === null || !series.x.length) return "";
    if (series.kind === "spans") {
      const here = [...series.x.keys()].filter((i) => series.x[i] <= x && x <= series.end[i]);
      return here.map((i) => this.spec.levels[series.y[i]]).join(", ");
    }
    return readable(this.numberAt(series, x));
  }

  speak(x, y) {
    const place = y !== null && this.spec.equal ? `${readable(x)}, ${readable(y)}` : readable(x);
    this.where.textContent = x === null ? "" : `${place} ${this.spec.unit || ""}`;
    for (const series of this.series) {
      if (series.value) series.value.textContent = series.shown ? this.valueAt(series, x) : "";
    }
  }

  legend(parent) {
    for (const series of this.series) {
      const button = pushButton(parent, null, () => {
        series.shown = !series.shown;
        this.full = null;
        button.setAttribute("aria-pressed", String(series.shown));
        const place = this.joined.indexOf(series);
        if (place >= 0) this.u.setSeries(place + 1, { show: series.shown });
        this.draw();
      });
      button.setAttribute("aria-pressed", "true");
      const sample = tag("i", `dash${series.dash || 0}`, button);
      sample.style.color = `var(--c${series.colour % 8})`;
      button.append(series.name);
      if (!["marks", "map", "points"].includes(series.kind)) series.value = tag("b", "", button);
    }
    this.where = tag("span", "where", parent);
  }

  drawBelow(u) {
    const { ctx, bbox } = u;
    const foot = u.valToPos(0, "y", true);
    if (this.spec.levels.length || foot < bbox.top || foot > bbox.top + bbox.height) return;
    ctx.fillStyle = ink("--soft");
    ctx.fillRect(bbox.left, Math.round(foot), bbox.width, u.pxRatio);
  }

  drawAbove(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    if (this.spec.linked) this.drawEvents(u);
    for (const series of this.series) {
      if (series.shown && DRAWN.has(series.kind)) this.drawSeries(u, series);
    }
    ctx.restore();
  }

  drawSeries(u, { kind, x, y, end, row, colour, dash }) {
    const { ctx, bbox } = u;
    const ratio = u.pxRatio;
    const [low, high] = this.xRange();
    ctx.strokeStyle = ctx.fillStyle = ink(`--c${colour % 8}`);
    ctx.lineWidth = (kind === "spans" ? 9 : 1.7) * ratio;
    ctx.setLineDash((kind === "map" ? DASHES[dash || 0] : []).map((length) => length * ratio));
    const ends = kind === "spans" ? end : x;
    ctx.beginPath();
    for (let i = 0; i < x.length; i++) {
      if (kind !== "map" && (ends[i] < low || x[i] > high)) continue;
      const px = u.valToPos(x[i], "x", true);
      const py = kind === "marks" ? bbox.top + bbox.height - 12 * ratio * (row || 0) : u.valToPos(y[i], "y", true);
      if (kind === "map") ctx.lineTo(px, py);
      else ctx.moveTo(px + (kind === "points" ? 5 * ratio : 0), py);
      if (kind === "marks") ctx.lineTo(px, py - 10 * ratio);
      else if (kind === "spans") ctx.lineTo(u.valToPos(end[i], "x", true) + ratio, py);
      else if (kind === "points") ctx.arc(px, py, 5 * ratio, 0, 2 * Math.PI);
    }
    ctx.stroke();
    ctx.globalAlpha = 0.55;
    if (kind === "points") ctx.fill();
    ctx.globalAlpha = 1;
  }

  // modes and fault codes on every plot over time; the cursors and commands on strips alone
  drawEvents(u) {
    const { ctx, bbox, pxRatio } = u;
    const first = shared.plots.find((plot) => plot.spec.named) === this;
    let free = [-Infinity, -Infinity]; // where the next name can begin, in two rows
    ctx.font = FONT.replace("12px", `${11 * pxRatio}px`);
    ctx.textBaseline = "top";
    ctx.textAlign = "left";
    ctx.lineWidth = pxRatio;
    const line = (t, colour, dash, text) => {
      const px = u.valToPos(t, "x", true);
      if (px < bbox.left - 1 || px > bbox.left + bbox.width + 1) return;
      ctx.strokeStyle = ctx.fillStyle = ink(colour);
      ctx.setLineDash(dash.map((length) => length * pxRatio));
      ctx.beginPath();
      ctx.moveTo(px, bbox.top);
      ctx.lineTo(px, bbox.top + bbox.height);
      ctx.stroke();
      const width = ctx.measureText(text).width + 6 * pxRatio;
      const left = px + width > bbox.left + bbox.width ? px - width : px;
      const row = free.findIndex((end) => left >= end);
      if (!text || row < 0) return;
      ctx.fillText(text, left + 3 * pxRatio, bbox.top + (2 + 11 * row) * pxRatio);
      free[row] = left + width;
    };
    for (const { t, text, bad } of shared.events) line(t, bad ? "--bad" : "--soft", [3, 3], first ? text : "");
    if (!this.spec.named) return;
    free = [-Infinity, -Infinity];
    for (const { t, text } of shared.marks) line(t, "--ink", [], text);
    for (const { colour, x } of shared.sent) this.drawSeries(u, { kind: "marks", x, colour, row: 0 });
  }

  // uPlot listens to the mouse: a finger across a plot zooms too, up and down scrolls the page
  touch() {
    const kinds = {
      pointerdown: "mousedown", pointermove: "mousemove", pointerup: "mouseup", pointercancel: "mouseup",
    };
    for (const [given, wanted] of Object.entries(kinds)) {
      this.u.over.addEventListener(given, (event) => {
        if (event.pointerType !== "touch") return;
        const { clientX, clientY } = event;
        // uPlot takes a move by nothing for no move
        this.u.over.dispatchEvent(new MouseEvent(wanted, { clientX, clientY, movementX: 1, bubbles: true }));
      });
    }
  }
}

function paper(wanted) {
  document.documentElement.classList.toggle("paper", wanted);
  drawAll();
}
window.addEventListener("resize", () => drawAll());
window.addEventListener("beforeprint", () => paper(true));
window.addEventListener("afterprint", () => paper(false));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => drawAll());
