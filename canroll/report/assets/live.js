"use strict";
// A running watch: what comes over the socket goes into plots, tiles, events and messages.

const setup = JSON.parse(document.getElementById("data").textContent);
const RETRY_MS = 1000;
const EVENTS_MAX = 200;
const MOODS = { INIT: "note", ACTIVE: "good", DEGRADED: "note", SAFE: "bad" };
const byId = (id) => document.getElementById(id);

const view = { now: 0, span: 30, dirty: false };
const spanButtons = [...document.querySelectorAll("[data-span]")];
const tiles = [...document.querySelectorAll("[data-value]")];
const faultRows = new Map();

const plots = setup.figures.map((spec) => {
  const figure = tag("figure", "", byId("plots"));
  figure.id = `figure-${spec.id}`;
  const plot = new Plot(figure, spec);
  plot.u.over.addEventListener("mouseleave", () => setCursor(null));
  return plot;
});
const curves = plots.flatMap((plot) =>
  plot.series.map((series, place) => ({ plot, series, ...plot.spec.sources[place] })));

function clear() {
  for (const { plot, series } of curves) {
    series.x = [];
    series.y = [];
    series.end = [];
    series.open = new Map();
    if (plot.spec.levels.length) plot.spec.levels.length = setup.modes.length;
  }
  faultRows.clear();
  byId("events").replaceChildren();
}

function faultRow(plot, bit) {
  if (!faultRows.has(bit)) {
    faultRows.set(bit, plot.spec.levels.length);
    plot.spec.levels.push(setup.faults[bit]);
  }
  return faultRows.get(bit);
}

function levelsOf({ plot, track }, value) {
  if (value === null) return [];
  if (track !== "faults") return [value];
  const active = Object.keys(setup.faults).filter((bit) => (value >> Number(bit)) & 1);
  return active.map((bit) => faultRow(plot, bit));
}

// what a row says holds until the next one, unless that comes too late
function addSpans(curve, t, value) {
  const { series, gap } = curve;
  const levels = levelsOf(curve, value);
  for (const [level, place] of series.open) {
    if (t - series.end[place] < gap) series.end[place] = t;
    else series.open.delete(level);
    if (!levels.includes(level)) series.open.delete(level);
  }
  for (const level of levels) {
    if (series.open.has(level)) continue;
    series.open.set(level, series.x.length);
    series.x.push(t);
    series.y.push(level);
    series.end.push(t);
  }
}

function add(curve, rows) {
  const { series, columns, scale, gap } = curve;
  for (const row of rows) {
    const t = row[0];
    if (series.kind === "spans") {
      addSpans(curve, t, row[1 + columns[0]]);
      continue;
    }
    const last = series.x[series.x.length - 1];
    if (t - last > gap) {
      series.x.push(last + 1e-4);
      series.y.push(NaN);
    }
    const parts = columns.map((column) => row[1 + column]);
    series.x.push(t);
    series.y.push(parts.includes(null) ? NaN : scale * parts.reduce((sum, part) => sum + part, 0));
  }
}

function forget({ series }) {
  const ends = series.kind === "spans" ? series.end : series.x;
  let old = 0;
  while (old < ends.length && ends[old] < view.now - setup.kept) old++;
  // in pieces, as every removal moves what is left
  if (old < (series.kind === "spans" ? 1 : 200)) return;
  for (const values of [series.x, series.y, series.end]) values.splice(0, old);
  for (const [level, place] of series.open) series.open.set(level, place - old);
}

function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function number(value, digits, signed) {
  if (typeof value !== "number") return value === null || value === undefined ? "–" : String(value);
  const text = Math.abs(value).toFixed(digits);
  const negative = value < 0 && Number(text) !== 0;
  return (negative ? "−" : signed ? "+" : "") + text;
}

function lookUp(values, key) {
  return key.split(".").reduce((inner, part) => (inner === null || inner === undefined ? null : inner[part]), values);
}

function showTiles(values) {
  for (const tile of tiles) {
    const { value, digits, scale, signed } = tile.dataset;
    const found = lookUp(values, value);
    say(tile, number(typeof found === "number" ? found * Number(scale) : found, Number(digits), signed !== undefined));
  }
  say(byId("mode").querySelector("b"), values.mode ?? "–");
  byId("mode").dataset.mood = MOODS[values.mode] ?? "";
  const known = values.mode !== null;
  say(byId("faults").querySelector("b"), values.fault_codes.join(", ") || (known ? "none" : "–"));
  byId("faults").dataset.mood = values.fault_codes.length ? "bad" : "";
}

function showMessages(values, rates) {
  const body = byId("messages");
  Object.entries(values.frames).forEach(([name, count], place) => {
    const row = body.rows[place] ?? body.insertRow();
    const cells = [name, String(count), rates[name].toFixed(0), name.startsWith("0x") ? "" : String(values.missing[name] ?? 0)];
    cells.forEach((text, column) => say(row.cells[column] ?? row.insertCell(), text));
  });
  say(byId("errors"), String(values.error_frames));
}

function showEvents(events) {
  const list = byId("events");
  for (const [t, text] of events) {
    const item = document.createElement("li");
    tag("time", "", item, `${t.toFixed(2)} s`);
    tag("span", "", item, text);
    list.prepend(item);
  }
  while (list.children.length > EVENTS_MAX) list.lastChild.remove();
}

function showState(kind, headline, text) {
  const box = byId("state");
  box.className = `verdict ${kind}`;
  say(box.querySelector("strong"), headline);
  let line = box.querySelector("span");
  if (!line) line = tag("span", "", box);
  say(line, text);
  document.body.toggleAttribute("data-stale", kind !== "good");
}

function take(message) {
  view.now = message.now;
  if (message.whole) clear();
  for (const curve of curves) {
    add(curve, message.rows[curve.track] ?? []);
    forget(curve);
  }
  showEvents(message.events);
  const { kind, headline, text } = message.state;
  showState(kind, headline, text);
  document.title = `${kind === "good" ? message.values.mode ?? headline : headline} – roll control`;
  showTiles(message.values);
  showMessages(message.values, message.rates);
  if (!view.dirty) requestAnimationFrame(draw);
  view.dirty = true;
}

function follow() {
  const start = Math.max(0, view.now - view.span);
  shared.window = [start, start + view.span];
}

function draw() {
  view.dirty = false;
  byId("pause").textContent = shared.range ? "Go on" : "Pause";
  byId("pause").setAttribute("aria-pressed", String(Boolean(shared.range)));
  // what is zoomed stays as it is, and a plot that is being dragged across must not be redrawn
  if (shared.range || shared.dragging) return;
  follow();
  for (const plot of plots) plot.renew();
  const under = plots.find((plot) => plot.pointer !== null);
  if (under) setCursor(under.u.posToVal(under.pointer, "x"), under);
  document.body.dataset.drawn = String(view.now);
}

function pause(wanted) {
  setRange(wanted ? shared.window : null);
  draw();
}

function choose(span) {
  view.span = span;
  for (const button of spanButtons) button.setAttribute("aria-pressed", String(Number(button.dataset.span) === span));
  pause(false);
}

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  socket.addEventListener("message", (event) => {
    document.body.removeAttribute("data-gone");
    take(JSON.parse(event.data));
  });
  socket.addEventListener("close", () => {
    document.body.setAttribute("data-gone", "");
    showState("bad", "The watch has ended", "The figures are the last received; the page continues when the watch is started again.");
    setTimeout(connect, RETRY_MS);
  });
}

byId("pause").addEventListener("click", () => pause(!shared.range));
for (const button of spanButtons) button.addEventListener("click", () => choose(Number(button.dataset.span)));
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const button = spanButtons[Number(event.key) - 1];
  if (event.key === " ") {
    event.preventDefault();
    pause(!shared.range);
  } else if (event.key === "Escape") pause(false);
  else if (button) button.click();
});
clear();
choose(30);
connect();
