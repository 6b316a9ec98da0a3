"use strict";
// Any recorded quantity of every run on strips with one time axis; two cursors; another page's runs.

// one margin, so that the same instants stand above each other
const STRIP = {
  unit: "s", linked: true, levels: [], height: 150, margin: 64, named: true, xlabel: "", ylabel: "",
};
const OVERLAID = [[5, 2], [4, 3], [6, 7]]; // colours of the runs of further pages

class Workbench {
  constructor(section, book) {
    this.book = book;
    this.recordings = book.runs.map((run) => new Recording(run, book, run.name));
    this.pages = [];
    this.chosen = new Set(); // what was asked for last, of which strips are those that are shown
    this.strips = new Map();
    this.cursors = { A: book.start, B: null };
    this.next = "A";
    this.queue = Promise.resolve();
    this.finder(section.querySelector(".finder"));
    this.place = section.querySelector(".strips");
    this.readings = section.querySelector(".readings tbody");
    this.message = section.querySelector(".message");
    this.overlaid = section.querySelector(".overlaid");
    this.frameList = new FrameList(section.querySelector(".frames"), () => this.keep());
    this.buttons = section.querySelectorAll("[data-cursor]");
    for (const button of this.buttons) button.addEventListener("click", () => this.turn(button.dataset.cursor));
    this.inputs = section.querySelectorAll("[data-instant]");
    for (const input of this.inputs) {
      input.addEventListener("change", () => {
        this.setCursorAt(input.dataset.instant, input.value === "" ? null : Number(input.value));
      });
    }
    section.querySelector("input[type=file]").addEventListener("change", (event) => this.take(event.target.files));
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      this.take(event.dataTransfer.files);
    });
    shared.zoomed.push(() => this.keep());
    window.addEventListener("hashchange", () => this.restore());
    shared.events = book.events;
  }

  // what strips of a long run leave out
  showSampling() {
    const longest = Math.max(...this.recordings.map((run) => run.data.signals.every));
    const text = `Of runs this long the strips have every ${longest} ms only; the plots below keep every peak.`;
    document.querySelector(".sampling").textContent = longest > 1 ? text : "";
  }

  async start() {
    await this.showWhole();
    const unpacked = async ({ colour, time }) => ({ colour, x: await unpackedColumn(time) });
    shared.sent = await Promise.all(this.book.sent.map(unpacked));
    await this.restore();
  }

  // one change after the other, so that a strip never appears twice; a failed one stops no later one
  enqueue(work) {
    const done = this.queue.then(work);
    this.queue = done.catch((error) => {
      this.message.textContent = String(error);
      this.chosen = new Set(this.strips.keys());
      this.changed();
    });
    return done;
  }

  async showWhole() {
    const times = await Promise.all(this.recordings.map((run) => run.column(run.data.signals.time)));
    shared.window = [0, Math.max(...times.map((time) => time[time.length - 1]))];
  }

  finder(parent) {
    const search = parent.querySelector("input");
    this.list = parent.querySelector("ul");
    search.addEventListener("input", () => this.filter(search.value));
    search.addEventListener("keydown", (event) => {
      if (event.key === "Enter") this.list.querySelector("li:not([hidden]) input")?.click();
    });
    this.offer();
  }

  offer() {
    this.showSampling();
    this.list.replaceChildren();
    this.quantities = new Map(this.recordings.flatMap((run) => run.quantities).map((q) => [q.id, q]).reverse());
    const order = ["vehicle", "ECU", "frame"];
    const rank = ({ from }) => order.indexOf(from);
    const sorted = [...this.quantities.values()].reverse().sort((one, other) => rank(one) - rank(other));
    for (const { id, label, unit } of sorted) {
      const item = tag("li", "", this.list);
      const line = tag("label", "", item);
      const box = tag("input", "", line);
      Object.assign(box, { type: "checkbox", value: id, checked: this.chosen.has(id) });
      box.addEventListener("change", () => this.choose(id, box.checked));
      line.append(` ${label}${unit ? ` (${unit})` : ""}`);
    }
  }

  filter(text) {
    const words = text.toLowerCase().split(/\s+/);
    for (const item of this.list.children) {
      const name = `${item.textContent} ${item.querySelector("input").value}`.toLowerCase();
      item.hidden = !words.every((word) => name.includes(word));
    }
  }

  choose(id, wanted) {
    if (wanted) this.chosen.add(id);
    else this.chosen.delete(id);
    return this.enqueue(() => this.showChosen());
  }

  // strips of all that is chosen by now, unpacked side by side
  async showChosen() {
    for (const id of [...this.strips.keys()]) if (!this.chosen.has(id)) this.remove(id);
    const missing = [...this.chosen].filter((id) => this.quantities.has(id) && !this.strips.has(id));
    const curves = await Promise.all(missing.map((id) => this.curves(id)));
    missing.forEach((id, place) => this.add(id, curves[place]));
    drawAll(missing.map((id) => this.strips.get(id)));
    this.changed();
  }

  async curves(id) {
    const curves = await Promise.all(this.recordings.map(async (run) => ({
      name: run.name, colour: run.colour ?? run.data.colour, dash: run.data.dash, ...(await run.curve(id)),
    })));
    return curves.filter(({ x }) => x?.length);
  }

  add(id, series) {
    const { label, unit } = this.quantities.get(id);
    const figure = tag("figure", "strip", this.place);
    figure.id = `strip-${id}`;
    const title = `${label}${unit ? ` (${unit})` : ""}`;
    const plot = new Plot(figure, { ...STRIP, title, series });
    const close = pushButton(figure.querySelector("figcaption"), "×", () => this.choose(id, false));
    close.setAttribute("aria-label", `remove ${title}`);
    plot.u.over.addEventListener("click", (event) => {
      const wanted = event.shiftKey ? { A: "B", B: "A" }[this.next] : this.next;
      this.setCursorAt(wanted, plot.u.posToVal(event.clientX - plot.u.over.getBoundingClientRect().left, "x"));
      this.turn({ A: "B", B: "A" }[wanted]);
    });
    this.strips.set(id, plot);
  }

  remove(id) {
    this.strips.get(id).remove();
    this.strips.delete(id);
  }

  changed() {
    for (const box of this.list.querySelectorAll("input")) box.checked = this.chosen.has(box.value);
    this.read();
    this.keep();
  }

  turn(cursor) {
    this.next = cursor;
    for (const button of this.buttons) button.setAttribute("aria-pressed", String(button.dataset.cursor === cursor));
  }

  setCursorAt(cursor, t) {
    this.cursors[cursor] = t;
    this.showCursors();
    if (t !== null) this.frameList.show(t);
    this.keep();
  }

  showCursors() {
    shared.marks = Object.entries(this.cursors).filter(([, t]) => t !== null).map(([text, t]) => ({ t, text }));
    for (const input of this.inputs) {
      const t = this.cursors[input.dataset.instant];
      input.value = t === null ? "" : t.toFixed(4);
    }
    for (const plot of this.strips.values()) plot.u.redraw(false, false);
    this.read();
  }

  // the values at both cursors and their difference, a row for each curve
  read() {
    const { A, B } = this.cursors;
    const difference = A === null || B === null ? NaN : B - A;
    for (const [name, value] of [["difference", difference], ["rate", 1 / Math.abs(difference)]]) {
      document.querySelector(`[data-cursors=${name}]`).textContent = readable(value);
    }
    this.readings.replaceChildren();
    for (const plot of this.strips.values()) {
      for (const series of plot.series) {
        const row = this.readings.insertRow();
        const [a, b] = [A, B].map((t) => plot.numberAt(series, t));
        row.insertCell().textContent = `${plot.spec.title}, ${series.name}`;
        for (const value of [a, b, b - a]) row.insertCell().textContent = readable(value);
      }
    }
  }

  async take(files) {
    for (const file of files) await this.enqueue(async () => this.overlay(file.name, await file.text()));
  }

  async overlay(name, text) {
    this.message.textContent = "";
    const book = recordedIn(text);
    if (!book || book.version !== this.book.version) {
      const why = book
        ? "was written by another version of canroll: write it again with canroll run FOLDER"
        : "holds no recorded run: drop the report.html of a run";
      this.message.textContent = `${name} ${why}`;
      return;
    }
    const number = this.pages.length + 2;
    this.pages.push(book);
    const colours = OVERLAID[(number - 2) % OVERLAID.length];
    const added = book.runs.map((run, place) => {
      const recording = new Recording(run, book, `${number}: ${run.name}`);
      recording.colour = colours[place % 2];
      return recording;
    });
    this.recordings.push(...added);
    const line = tag("p", "", this.overlaid, `${number}: ${book.title} `);
    pushButton(line, "remove", () => this.enqueue(async () => {
      this.recordings = this.recordings.filter((recording) => !added.includes(recording));
      line.remove();
      await this.renew();
    }));
    await this.renew();
  }

  // all strips again, after runs were added or removed
  async renew() {
    this.offer();
    await this.showWhole();
    for (const id of [...this.strips.keys()]) this.remove(id);
    await this.showChosen();
    setRange(shared.range);
    this.frameList.offer(this.recordings);
    this.showCursors();
  }

  // the address keeps what is chosen, so that it can be sent and opened again
  keep() {
    if (this.restoring) return;
    const state = {
      s: [...this.strips.keys()].join(","),
      t: shared.range?.map((t) => t.toFixed(4)).join(","),
      a: this.cursors.A?.toFixed(4),
      b: this.cursors.B?.toFixed(4),
      ...this.frameList.state(),
    };
    const words = Object.entries(state)
      .filter(([, value]) => value !== undefined && value !== "")
      .map(([key, value]) => `${key}=${encodeURIComponent(value).replaceAll("%2C", ",")}`);
    this.kept = `#${words.join("&")}`;
    history.replaceState(null, "", this.kept);
  }

  restore() {
    if (this.kept === location.hash && this.kept) return this.queue;
    return this.enqueue(async () => {
      this.restoring = true;
      const state = new URLSearchParams(location.hash.slice(1));
      const instant = (key) => (Number.isFinite(parseFloat(state.get(key))) ? parseFloat(state.get(key)) : null);
      const chosen = state.has("s") || state.has("t") ? (state.get("s") ?? "").split(",") : this.book.chosen;
      for (const id of [...this.strips.keys()]) this.remove(id);
      this.cursors = { A: instant("a") ?? (state.has("b") ? null : this.book.start), B: instant("b") };
      this.chosen = new Set(chosen);
      await this.showChosen();
      const range = (state.get("t") ?? "").split(",").map(Number);
      setRange(range.length === 2 && range[0] < range[1] ? range : null);
      this.frameList.offer(this.recordings);
      this.frameList.restore(state);
      this.turn("A");
      this.showCursors();
      await this.frameList.show(this.cursors.A ?? this.cursors.B ?? this.book.start);
      this.restoring = false;
    });
  }
}
