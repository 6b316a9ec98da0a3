"use strict";
// The frames of one run around an instant, with their fields.

const AROUND = 12;

class FrameList {
  constructor(section, changed) {
    section.open = !matchMedia("(max-width: 640px)").matches;
    this.rows = section.querySelector("tbody");
    this.note = section.querySelector(".until");
    this.choice = section.querySelector("select");
    this.all = section.querySelector("input[type=checkbox]");
    this.instant = null;
    for (const control of [this.choice, this.all]) {
      control.addEventListener("change", () => {
        this.show(this.instant);
        changed();
      });
    }
  }

  offer(recordings) {
    const chosen = this.choice.value;
    this.recordings = recordings;
    this.choice.replaceChildren();
    recordings.forEach((run, place) => { tag("option", "", this.choice, run.name).value = place; });
    const last = this.recordings.findLastIndex((run) => run.colour === undefined);
    this.choice.value = chosen !== "" && chosen < recordings.length ? chosen : last;
  }

  state() {
    return { run: this.choice.value, all: this.all.checked ? 1 : undefined };
  }

  restore(state) {
    if (state.has("run") && state.get("run") < this.recordings.length) this.choice.value = state.get("run");
    this.all.checked = state.has("all");
  }

  async show(t) {
    this.instant = t;
    const run = this.recordings[this.choice.value];
    const { frames, before } = await run.around(t, AROUND, !this.all.checked);
    if (this.instant !== t) return; // a later call was quicker
    const until = run.data.frames_until;
    const cut = (s) => `Of this run the page has frames up to ${s.toFixed(2)} s only; trace.npz has all.`;
    this.note.textContent = until === null ? "" : cut(until);
    this.rows.replaceChildren();
    frames.forEach((frame, place) => this.add(frame, place === before, run.book.outcomes));
  }

  add({ t, stream, message, data, outcome }, here, outcomes) {
    const row = this.rows.insertRow();
    row.className = `${here ? "here" : ""} ${outcome ? "lost" : ""}`;
    row.insertCell().textContent = t.toFixed(4);
    row.insertCell().textContent = `0x${stream.key}`;
    row.insertCell().textContent = message ? message.name : "–";
    const fields = message ? Object.values(fieldsOf(message, data)).map(fieldText) : ["no description"];
    if (stream.segment) fields.unshift(`segment ${stream.segment}`);
    if (outcome) fields.unshift(outcomes[outcome]);
    const cell = row.insertCell();
    for (const text of fields) tag("span", "", cell, text);
  }
}
