"use strict";
// Small interactive plots: drag to zoom, double-click to reset, hover to read, legend to hide.
// Every time plot shares one range and one cursor, so that all show the same moment.

const DASHES = ["", "7 4", "2 3", "10 3 2 3"];

// window: what linked plots show while nobody has zoomed; dragging: a pointer is down on a plot
const shared = { range: null, window: null, cursor: null, dragging: false, plots: [], listeners: [] };

function setCursor(x, source = null) {
  shared.cursor = x;
  for (const plot of shared.plots) if (plot.spec.linked) plot.drawCursor(plot === source);
  for (const listener of shared.listeners) listener(x, source);
}

class Plot {
  constructor(figure, spec) {
    this.figure = figure;
    this.spec = spec;
    this.range = null;
    this.yRange = null;
    this.cursor = null;
    this.pointer = null;
    this.series = spec.series.map((s) => ({ ...s, x: decode(s.x), y: decode(s.y), shown: true }));
    const caption = tag("figcaption", "", figure);
    tag("h3", "", caption, spec.title);
    const reset = tag("button", "reset", caption, "reset zoom");
    reset.type = "button";
    reset.addEventListener("click", () => this.zoom(null, null));
    if (spec.note) tag("p", "", figure, spec.note);
    this.svg = element("svg", { role: "img", "aria-label": spec.title }, figure);
    this.legend(tag("div", "legend", figure));
    this.tip = tag("div", "tip", figure);
    this.tip.hidden = true;
    this.listen();
    shared.plots.push(this);
  }

  colour(series) {
    return `var(--c${series.colour % 8})`;
  }

  legend(parent) {
    for (const series of this.series) {
      const button = tag("button", "", parent);
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      const sample = element("svg", { viewBox: "0 0 28 10" }, button);
      const mark = { d: "M0 5H28", fill: "none", "stroke-width": 3, "stroke-dasharray": DASHES[series.dash || 0] };
      element("path", mark, sample).style.stroke = this.colour(series);
      button.append(series.name);
      button.addEventListener("click", () => {
        series.shown = !series.shown;
        button.setAttribute("aria-pressed", String(series.shown));
        this.draw();
      });
    }
  }

  fullRange() {
    let lo = Infinity;
    let hi = -Infinity;
    for (const { x, shown } of this.series) {
      if (!shown) continue;
      for (const value of x) {
        if (value < lo) lo = value;
        if (value > hi) hi = value;
      }
    }
    if (!(hi > lo)) return Number.isFinite(lo) ? [lo - 0.5, lo + 0.5] : [0, 1];
    return [lo, hi];
  }

  valueRange([lo, hi]) {
    if (this.spec.levels.length) return [this.spec.levels.length - 0.5, -0.5];
    const { zero, least } = this.spec;
    let bottom = zero ? 0 : least ? -least : Infinity;
    let top = zero || least ? least : -Infinity;
    for (const { x, y, shown, kind } of this.series) {
      if (!shown || kind === "marks") continue;
      for (let i = 0; i < x.length; i++) {
        if (x[i] < lo || x[i] > hi || !Number.isFinite(y[i])) continue;
        if (y[i] < bottom) bottom = y[i];
        if (y[i] > top) top = y[i];
      }
    }
    if (!(top >= bottom)) return [0, 1];
    const pad = (top - bottom || Math.abs(top) || 1) * 0.06;
    return [bottom === 0 && this.spec.zero ? 0 : bottom - pad, top + pad];
  }

  draw() {
    const width = Math.max(this.figure.clientWidth - 26, 200);
    const levels = this.spec.levels;
    const least = levels.length ? 16 * levels.length + 44 : 0;
    const height = this.spec.equal ? Math.min(300, width * 0.6) : Math.max(Math.min(250, width * 0.62), least);
    const left = Math.max(52, ...levels.map((name) => 16 + 7.4 * name.length));
    const box = { left, right: width - 16, top: 8, bottom: height - 36 };
    this.box = box;
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.style.height = `${height}px`;
    this.svg.replaceChildren();
    const zoomed = this.spec.linked ? shared.range : this.range;
    const xr = zoomed || (this.spec.linked && shared.window) || this.fullRange();
    const yr = this.yRange || this.valueRange(xr);
    this.figure.classList.toggle("zoomed", Boolean(zoomed || this.yRange));
    this.sx = (x) => box.left + ((x - xr[0]) / (xr[1] - xr[0])) * (box.right - box.left);
    this.sy = (y) => box.bottom - ((y - yr[0]) / (yr[1] - yr[0])) * (box.bottom - box.top);
    this.ux = (px) => xr[0] + ((px - box.left) / (box.right - box.left)) * (xr[1] - xr[0]);
    this.uy = (py) => yr[0] + ((box.bottom - py) / (box.bottom - box.top)) * (yr[1] - yr[0]);
    this.axes(xr, yr, box, width, height);
    const clip = `clip-${shared.plots.indexOf(this)}`;
    const frame = element("clipPath", { id: clip }, element("defs", {}, this.svg));
    element("rect", { x: box.left, y: box.top, width: box.right - box.left, height: box.bottom - box.top }, frame);
    const layer = element("g", { "clip-path": `url(#${clip})` }, this.svg);
    let points = 0;
    for (const series of this.series) if (series.shown) points += this.path(series, xr, layer);
    this.figure.dataset.points = String(points);
    this.overlay = element("g", {}, this.svg);
    this.drawCursor(false);
  }

  axes(xr, yr, box, width, height) {
    for (const [value, label] of ticks(xr[0], xr[1], Math.max(4, Math.floor(width / 90)))) {
      const x = this.sx(value);
      element("path", { class: "axis", d: `M${x} ${box.top}V${box.bottom}` }, this.svg);
      element("text", { x, y: box.bottom + 15, "text-anchor": "middle" }, this.svg, label);
    }
    const levels = this.spec.levels;
    const named = levels.map((name, place) => [place, name]);
    for (const [value, label] of levels.length ? named : ticks(yr[0], yr[1], Math.floor(height / 45))) {
      const y = this.sy(value);
      const kind = value === 0 && !levels.length ? "zero" : "axis";
      element("path", { class: kind, d: `M${box.left} ${y}H${box.right}` }, this.svg);
      element("text", { x: box.left - 5, y: y + 4, "text-anchor": "end" }, this.svg, label);
    }
    const middle = (box.left + box.right) / 2;
    element("text", { x: middle, y: height - 4, "text-anchor": "middle" }, this.svg, this.spec.xlabel);
    if (levels.length) return;
    const turn = `rotate(-90 12 ${(box.top + box.bottom) / 2})`;
    const label = { x: 12, y: (box.top + box.bottom) / 2, "text-anchor": "middle", transform: turn };
    element("text", label, this.svg, this.spec.ylabel);
  }

  path(series, xr, layer) {
    const { x, y, kind } = series;
    let d = "";
    let points = 0;
    if (kind === "marks") {
      for (const value of x) {
        if (value < xr[0] || value > xr[1]) continue;
        const base = this.box.bottom - 12 * (series.row || 0);
        d += `M${this.sx(value).toFixed(1)} ${base}v-10`;
        points++;
      }
    } else if (kind === "bars") {
      const base = this.sy(0);
      for (let i = 0; i < x.length; i++) {
        const left = this.sx(x[i]) + 0.5;
        const right = this.sx(x[i] + series.width) - 0.5;
        d += `M${left.toFixed(1)} ${base.toFixed(1)}V${this.sy(y[i]).toFixed(1)}H${right.toFixed(1)}V${base.toFixed(1)}Z`;
        points++;
      }
    } else if (kind === "spans") {
      for (let i = 0; i < x.length; i++) {
        if (series.end[i] < xr[0] || x[i] > xr[1]) continue;
        d += `M${this.sx(x[i]).toFixed(1)} ${this.sy(y[i]).toFixed(1)}H${(this.sx(series.end[i]) + 1).toFixed(1)}`;
        points++;
      }
    } else if (kind === "points") {
      for (let i = 0; i < x.length; i++) {
        d += `M${(this.sx(x[i]) - 5).toFixed(1)} ${this.sy(y[i]).toFixed(1)}a5 5 0 1 0 10 0a5 5 0 1 0 -10 0Z`;
        points++;
      }
    } else {
      [d, points] = this.line(series, xr);
    }
    const node = element("path", { class: kind === "spans" ? "series spans" : "series", d }, layer);
    node.style.stroke = this.colour(series);
    if (kind === "bars" || kind === "points") {
      node.style.fill = this.colour(series);
      node.style.fillOpacity = "0.55";
    }
    if (series.dash) node.setAttribute("stroke-dasharray", DASHES[series.dash]);
    return points;
  }

  line({ x, y, kind }, xr) {
    const columns = this.box.right - this.box.left;
    const ordered = !this.spec.equal;
    let first = 0;
    let last = x.length - 1;
    if (ordered) {
      while (first < last && x[first + 1] < xr[0]) first++;
      while (last > first && x[last - 1] > xr[1]) last--;
    }
    const stride = ordered ? Math.max(1, Math.floor((last - first) / columns / 2)) : 1;
    const parts = [];
    let pen = false;
    let previous = 0;
    const add = (i) => {
      if (!Number.isFinite(y[i])) {
        pen = false;
        return;
      }
      const px = this.sx(x[i]).toFixed(1);
      const py = this.sy(y[i]).toFixed(1);
      parts.push(!pen ? `M${px} ${py}` : kind === "step" ? `H${px}V${py}` : `L${px} ${py}`);
      pen = true;
      previous = i;
    };
    for (let i = first; i <= last; i += stride) {
      // of each stretch the extremes are kept, so that no peak is lost to decimation
      let low = i;
      let high = i;
      for (let j = i; j < Math.min(i + stride, last + 1); j++) {
        if (y[j] < y[low]) low = j;
        if (y[j] > y[high]) high = j;
      }
      add(Math.min(low, high));
      if (high !== low) add(Math.max(low, high));
    }
    if (previous < last) add(last);
    return [parts.join(""), parts.length];
  }

  zoom(xr, yr) {
    this.yRange = yr;
    if (this.spec.linked) {
      shared.range = xr;
      if (!xr) for (const plot of shared.plots) if (plot.spec.linked) plot.yRange = null;
      for (const plot of shared.plots) if (plot.spec.linked) plot.draw();
    } else {
      this.range = xr;
      this.draw();
    }
  }

  place(event) {
    const bounds = this.svg.getBoundingClientRect();
    const scale = this.svg.viewBox.baseVal.width / bounds.width;
    return [(event.clientX - bounds.left) * scale, (event.clientY - bounds.top) * scale];
  }

  listen() {
    let start = null;
    let band = null;
    this.svg.addEventListener("pointerdown", (event) => {
      start = this.place(event);
      shared.dragging = true;
      this.svg.setPointerCapture(event.pointerId);
    });
    this.svg.addEventListener("pointermove", (event) => {
      const [px, py] = this.place(event);
      this.pointer = [px, py];
      const x = this.ux(px);
      if (this.spec.linked) setCursor(x, this);
      else {
        this.cursor = x;
        this.drawCursor(true, py);
      }
      if (!start) return;
      if (!band) band = element("rect", { class: "band" }, this.svg);
      const vertical = this.spec.equal;
      band.setAttribute("x", Math.min(px, start[0]));
      band.setAttribute("width", Math.abs(px - start[0]));
      band.setAttribute("y", vertical ? Math.min(py, start[1]) : this.box.top);
      band.setAttribute("height", vertical ? Math.abs(py - start[1]) : this.box.bottom - this.box.top);
    });
    const finish = (event) => {
      if (band) band.remove();
      band = null;
      if (start && event.type === "pointerup") {
        const [px, py] = this.place(event);
        if (Math.abs(px - start[0]) > 6) {
          const xr = [this.ux(start[0]), this.ux(px)].sort((a, b) => a - b);
          const yr = this.spec.equal ? [this.uy(start[1]), this.uy(py)].sort((a, b) => a - b) : null;
          this.zoom(xr, yr && yr[1] > yr[0] ? yr : null);
        }
      }
      start = null;
      shared.dragging = false;
    };
    this.svg.addEventListener("pointerup", finish);
    this.svg.addEventListener("pointercancel", finish);
    this.svg.addEventListener("pointerleave", () => {
      this.pointer = null;
      this.tip.hidden = true;
    });
    this.svg.addEventListener("dblclick", () => this.zoom(null, null));
  }

  drawCursor(speak, py = null) {
    if (!this.overlay) return;
    this.overlay.replaceChildren();
    const x = this.spec.linked ? shared.cursor : this.cursor;
    if (!speak) this.tip.hidden = true;
    if (x === null || this.spec.equal && py === null) return;
    const px = this.sx(x);
    if (px < this.box.left || px > this.box.right) return;
    if (!this.spec.equal) {
      element("path", { class: "cursor", d: `M${px} ${this.box.top}V${this.box.bottom}` }, this.overlay);
    }
    if (speak) this.speak(x, px, py);
  }

  speak(x, px, py) {
    this.tip.replaceChildren();
    const head = this.spec.equal ? `${readable(x)}, ${readable(this.uy(py))} ${this.spec.unit || ""}` : `${readable(x)} ${this.spec.unit || ""}`;
    tag("div", "", this.tip, head);
    for (const series of this.series) {
      if (!series.shown || series.kind === "marks" || this.spec.equal || !series.x.length) continue;
      if (series.kind === "spans") {
        this.speakSpans(series, x);
        continue;
      }
      let i = nearest(series.x, x);
      if (series.kind === "points" && Math.abs(this.sx(series.x[i]) - px) > 12) continue;
      if ((series.kind === "step" || series.kind === "bars") && series.x[i] > x && i > 0) i--;
      const row = tag("div", "", this.tip);
      tag("i", "", row).style.background = this.colour(series);
      row.append(`${series.name}: ${readable(series.y[i])}`);
    }
    this.tip.hidden = false;
    const offset = this.svg.offsetLeft ?? 0;
    const left = px > (this.box.left + this.box.right) / 2 ? px - this.tip.offsetWidth - 12 : px + 16;
    this.tip.style.left = `${Math.max(0, left + offset)}px`;
    this.tip.style.top = `${this.svg.getBoundingClientRect().top - this.figure.getBoundingClientRect().top + 10}px`;
  }

  speakSpans(series, x) {
    for (let i = 0; i < series.x.length; i++) {
      if (series.x[i] <= x && x <= series.end[i]) {
        const row = tag("div", "", this.tip);
        tag("i", "", row).style.background = this.colour(series);
        row.append(`${series.name}: ${this.spec.levels[series.y[i]]}`);
      }
    }
  }
}

function drawAll() {
  for (const plot of shared.plots) plot.draw();
}
