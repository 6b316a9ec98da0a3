"use strict";
// The recorded runs of a page: columns unpacked when they are asked for, frames decoded.
// canroll/report/columns.py and canroll/report/workbench.py write what is read here.

async function inflated(packed) {
  const stream = new Blob([bytesOf(packed)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function unpackedColumn({ count, low, step, packed }) {
  const bytes = await inflated(packed);
  const values = new Float64Array(count);
  let change = 0;
  let place = 0;
  for (let i = 0; i < count; i++) {
    const folded = bytes[i] | (bytes[count + i] << 8) | (bytes[2 * count + i] << 16) | (bytes[3 * count + i] << 24);
    change = (change + ((folded >>> 1) ^ -(folded & 1))) | 0;
    place = (place + change) | 0;
    values[i] = place < 0 ? NaN : low + step * place;
  }
  return values;
}

async function unpackedPayloads({ payload, width, time }) {
  const bytes = await inflated(payload);
  for (let i = 0; i < bytes.length; i++) if (i % time.count) bytes[i] += bytes[i - 1];
  return (frame) => Uint8Array.from({ length: width }, (_, place) => bytes[place * time.count + frame]);
}

function fieldValue({ bits, signed, float, scale, offset }, data) {
  let raw = 0;
  for (const bit of bits) raw = raw * 2 + ((data[bit >> 3] >> (bit & 7)) & 1);
  if (float) {
    const view = new DataView(new ArrayBuffer(8));
    if (bits.length === 32) view.setUint32(0, raw);
    else view.setBigUint64(0, bits.reduce((sum, bit) => sum * 2n + BigInt((data[bit >> 3] >> (bit & 7)) & 1), 0n));
    raw = bits.length === 32 ? view.getFloat32(0) : view.getFloat64(0);
  } else if (signed && raw >= 2 ** (bits.length - 1)) raw -= 2 ** bits.length;
  return { raw, value: raw * scale + offset };
}

// the fields of a frame: those of another page of a multiplexed message and cut ones are left out
function fieldsOf(message, data) {
  const found = {};
  for (const field of message.fields) {
    if (field.bits.some((bit) => bit >> 3 >= data.length)) continue;
    found[field.name] = { ...fieldValue(field, data), field };
  }
  const isOn = ({ field }) => !field.switch || field.pages.includes(found[field.switch]?.raw);
  const shown = Object.values(found).filter(isOn);
  return Object.fromEntries(shown.map((value) => [value.field.name, value]));
}

function fieldText({ raw, value, field }) {
  const digits = Math.min(6, Math.max(0, Math.ceil(-Math.log10(Math.abs(field.scale)) - 1e-9)));
  const text = field.names[raw] ?? (field.float ? readable(value) : value.toFixed(digits));
  return `${field.name} ${text}${field.unit && !(raw in field.names) ? ` ${field.unit}` : ""}`;
}

// the runs in the text of a page, or null
function recordedIn(text) {
  const data = new DOMParser().parseFromString(text, "text/html").getElementById("data");
  try {
    return JSON.parse(data.textContent).workbench ?? null;
  } catch {
    return null;
  }
}

class Recording {
  constructor(data, book, name) {
    Object.assign(this, { data, book, name, cache: new Map() });
    this.quantities = [...this.listed()];
  }

  // every quantity: id, label, unit, where it is from
  *listed() {
    for (const [name, { unit }] of Object.entries(this.data.signals.curves)) {
      yield { id: name, label: name.replaceAll("_", " "), unit, from: "vehicle" };
    }
    for (const [name, { unit }] of Object.entries(this.data.ticks.curves)) {
      yield { id: `ecu.${name}`, label: `ECU: ${name.replaceAll("_", " ")}`, unit, from: "ECU" };
    }
    const seen = new Set();
    for (const { key } of this.data.frames) {
      const message = this.book.messages[key];
      if (!message || seen.has(key)) continue;
      seen.add(key);
      for (const { name, unit } of message.fields) {
        yield { id: `${message.name}.${name}`, label: `${message.name}.${name}`, unit, from: "frame" };
      }
    }
  }

  once(name, make) {
    if (!this.cache.has(name)) this.cache.set(name, make());
    return this.cache.get(name);
  }

  column(packed) {
    return this.once(packed, () => unpackedColumn(packed));
  }

  // x, y and kind of a quantity, or null if this run has none of that id
  async curve(id) {
    const dot = id.indexOf(".");
    const [owner, name] = [id.slice(0, Math.max(dot, 0)), id.slice(dot + 1)];
    const table = { "": this.data.signals, ecu: this.data.ticks }[owner] ?? null;
    if (table === null) return (await this.fields(owner))[name] ?? null;
    if (!table.curves[name]) return null;
    const [x, y] = await Promise.all([this.column(table.time), this.column(table.curves[name])]);
    return { x, y, kind: owner === "ecu" ? "step" : "line" };
  }

  // the curves of all fields of a message by their names; its frames are decoded once
  fields(owner) {
    return this.once(`${owner}.`, async () => {
      const curves = {};
      const stream = this.data.frames.find(({ key }) => this.book.messages[key]?.name === owner);
      if (!stream) return curves;
      const { times, data, outcomes } = await this.frames(stream);
      for (let i = 0; i < times.length; i++) {
        if (outcomes?.[i]) continue;
        for (const { value, field } of Object.values(fieldsOf(this.book.messages[stream.key], data(i)))) {
          const { x, y } = (curves[field.name] ??= { x: [], y: [], kind: "step" });
          x.push(times[i]);
          y.push(value);
        }
      }
      return curves;
    });
  }

  // the frames of a message: their times, the bytes of one by its number, how each one ended
  frames(stream) {
    return this.once(stream, async () => {
      const [times, bytes] = await Promise.all([this.column(stream.time), unpackedPayloads(stream)]);
      const lengths = stream.length ? await inflated(stream.length) : null;
      const outcomes = stream.outcome ? await inflated(stream.outcome) : null;
      return { times, outcomes, data: (i) => bytes(i).subarray(0, lengths?.[i] ?? stream.width) };
    });
  }

  // the so many frames before an instant and as many after it, in order
  async around(t, count, described) {
    const found = [];
    for (const stream of this.data.frames) {
      const message = this.book.messages[stream.key];
      if (described && !message) continue;
      const { times, data, outcomes } = await this.frames(stream);
      const place = times[0] <= t ? before(times, t) + 1 : 0;
      for (let i = Math.max(0, place - count); i < Math.min(times.length, place + count); i++) {
        found.push({ t: times[i], stream, message, data: data(i), outcome: outcomes ? outcomes[i] : 0 });
      }
    }
    found.sort((one, other) => one.t - other.t);
    const middle = found.filter((frame) => frame.t <= t).length;
    return { frames: found.slice(Math.max(0, middle - count), middle + count), before: Math.min(middle, count) };
  }
}
