"use strict";
// The recorded motion played back: the car from behind, and on its path from above.

class Playback {
  constructor(section, data) {
    this.cars = data.cars.map((car) => {
      const signals = Object.fromEntries(Object.entries(car.signals).map(([k, v]) => [k, decode(v)]));
      return { ...car, signals };
    });
    this.data = data;
    this.step = data.step;
    this.end = Math.max(...this.cars.map((car) => car.signals.roll.length - 1)) * this.step;
    this.time = Math.min(data.start, this.end);
    this.playing = false;
    const views = tag("div", "views", section);
    this.rear = this.canvas(views, "from behind, roll angle drawn three times as large");
    this.top = this.canvas(views, "from above");
    this.controls(tag("div", "controls", section));
    shared.listeners.push((x, source) => {
      if (source !== this && !this.playing) this.show(x);
    });
    this.show(this.time);
  }

  canvas(parent, text) {
    const figure = tag("figure", "", parent);
    tag("p", "", figure, text);
    return tag("canvas", "", figure);
  }

  controls(parent) {
    this.button = tag("button", "", parent, "▶ play");
    this.button.type = "button";
    this.button.addEventListener("click", () => this.toggle());
    this.slider = tag("input", "", parent);
    Object.assign(this.slider, { type: "range", min: 0, max: this.end, step: this.step });
    this.slider.setAttribute("aria-label", "time");
    this.slider.addEventListener("input", () => {
      this.show(Number(this.slider.value));
      setCursor(this.time, this);
    });
    this.label = tag("span", "", parent);
    const speed = tag("select", "", parent);
    speed.setAttribute("aria-label", "playback speed");
    for (const factor of [0.25, 0.5, 1]) tag("option", "", speed, `× ${factor}`).value = factor;
    speed.value = "0.5";
    this.factor = () => Number(speed.value);
  }

  toggle() {
    this.playing = !this.playing;
    this.button.textContent = this.playing ? "❚❚ pause" : "▶ play";
    if (!this.playing) return;
    if (this.time >= this.end - this.step) this.time = 0;
    let before = null;
    const frame = (now) => {
      if (!this.playing) return;
      if (before !== null) this.show(this.time + ((now - before) / 1000) * this.factor());
      before = now;
      setCursor(this.time, this);
      if (this.time >= this.end) this.toggle();
      else requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  show(time) {
    this.time = Math.min(Math.max(time, 0), this.end);
    this.slider.value = this.time;
    this.label.textContent = `${this.time.toFixed(2)} s`;
    const style = getComputedStyle(document.documentElement);
    this.ink = (name) => style.getPropertyValue(name).trim();
    this.drawRear(this.context(this.rear));
    this.drawTop(this.context(this.top));
  }

  context(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return context;
  }

  value(car, name) {
    const values = car.signals[name];
    const place = Math.min(this.time / this.step, values.length - 1);
    const i = Math.floor(place);
    const j = Math.min(i + 1, values.length - 1);
    return values[i] + (values[j] - values[i]) * (place - i);
  }

  drawRear(context) {
    const width = context.canvas.clientWidth;
    const height = context.canvas.clientHeight;
    const cell = width / this.cars.length;
    this.cars.forEach((car, index) => this.rearView(context, car, cell * (index + 0.5), cell, height));
  }

  rearView(context, car, centre, cell, height) {
    const { half_track: track, width: body, height: top, roll_centre: pivot, static_load: load } = this.data.vehicle;
    const scale = Math.min((cell * 0.72) / body, (height - 78) / (top * 1.12));
    const ground = height - 44;
    const colour = this.ink(`--c${car.colour % 8}`);
    const roll = this.value(car, "roll");
    context.lineWidth = 1;
    context.strokeStyle = this.ink("--soft");
    context.beginPath();
    context.moveTo(centre - cell * 0.47, ground);
    context.lineTo(centre + cell * 0.47, ground);
    context.stroke();
    // seen from behind, the left side is on the left; roll > 0 lifts it: clockwise on the screen
    for (const [side, name] of [[-1, "left"], [1, "right"]]) {
      const x = centre + side * track * scale;
      context.fillStyle = this.ink("--soft");
      context.fillRect(x - 0.11 * scale, ground - 0.66 * scale, 0.22 * scale, 0.66 * scale);
      if (!load) continue; // a plant without wheel loads
      const share = (this.value(car, `wheel_load_front_${name}`) + this.value(car, `wheel_load_rear_${name}`)) / (2 * load);
      context.fillStyle = colour;
      context.fillRect(x - 9, ground + 3, 18, Math.min(Math.max(share, 0), 2.2) * 13);
    }
    context.save();
    context.translate(centre, ground - pivot * scale);
    context.rotate(roll * 3);
    context.strokeStyle = colour;
    context.lineWidth = 2.5;
    const low = (0.3 - pivot) * scale;
    const high = (top - pivot) * scale;
    const half = (body / 2) * scale;
    const waist = low + (high - low) * 0.5;
    context.beginPath();
    context.moveTo(-half, -low);
    context.lineTo(-half, -waist);
    context.lineTo(-half * 0.84, -high);
    context.lineTo(half * 0.84, -high);
    context.lineTo(half, -waist);
    context.lineTo(half, -low);
    context.closePath();
    context.globalAlpha = 0.14;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
    context.stroke();
    context.beginPath();
    context.moveTo(-half * 0.95, -waist);
    context.lineTo(half * 0.95, -waist);
    context.stroke();
    context.restore();
    context.fillStyle = this.ink("--ink");
    context.font = "13px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(`${car.name}  ${((roll * 180) / Math.PI).toFixed(2).replace("-", "−")}°`, centre, 14, cell - 8);
    context.fillStyle = this.ink("--soft");
    context.font = "11px system-ui, sans-serif";
    if (load && cell > 150) context.fillText("wheel load", centre, ground + 14);
  }

  drawTop(context) {
    const width = context.canvas.clientWidth;
    const height = context.canvas.clientHeight;
    const lead = this.cars[this.cars.length - 1];
    const eye = [this.value(lead, "x"), this.value(lead, "y")];
    const metres = 70;
    const scale = width / metres;
    const across = scale * 1.6;
    const px = (x) => width * 0.42 + (x - eye[0]) * scale;
    const py = (y) => height / 2 - (y - eye[1] * 0.5) * across;
    context.strokeStyle = this.ink("--line");
    context.fillStyle = this.ink("--soft");
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center";
    for (let x = Math.ceil((eye[0] - 40) / 10) * 10; x < eye[0] + 60; x += 10) {
      context.beginPath();
      context.moveTo(px(x), 0);
      context.lineTo(px(x), height - 16);
      context.stroke();
      context.fillText(`${x} m`, px(x), height - 4);
    }
    context.fillStyle = this.ink("--c2");
    for (const [x, y] of this.data.cones) {
      context.beginPath();
      context.arc(px(x), py(y), 3, 0, 2 * Math.PI);
      context.fill();
    }
    for (const car of this.cars) this.trail(context, car, px, py);
    for (const car of this.cars) this.topView(context, car, px, py, scale, across);
  }

  trail(context, car, px, py) {
    context.strokeStyle = this.ink(`--c${car.colour % 8}`);
    context.lineWidth = 1.4;
    context.beginPath();
    const { x, y } = car.signals;
    for (let i = 0; i < x.length; i++) context.lineTo(px(x[i]), py(y[i]));
    context.stroke();
  }

  topView(context, car, px, py, scale, across) {
    const { front, rear, width } = this.data.vehicle;
    const x = this.value(car, "x");
    const y = this.value(car, "y");
    const yaw = this.value(car, "yaw");
    const corner = (forward, left) => [
      px(x + forward * Math.cos(yaw) - left * Math.sin(yaw)),
      py(y + forward * Math.sin(yaw) + left * Math.cos(yaw)),
    ];
    context.beginPath();
    const nose = front + 0.9;
    const tail = -rear - 0.9;
    for (const [forward, left] of [[nose, 0.8], [nose, -0.8], [tail, -1], [tail, 1]]) {
      context.lineTo(...corner(forward, (left * width) / 2));
    }
    context.closePath();
    context.fillStyle = this.ink(`--c${car.colour % 8}`);
    context.globalAlpha = 0.35;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = context.fillStyle;
    context.lineWidth = 2;
    context.stroke();
  }
}
