"use strict";
// What plots, playback and workbench share: elements, packed numbers, numbers as text.

function tag(name, className, parent, text = null) {
  const node = document.createElement(name);
  if (className) node.className = className;
  if (text !== null) node.textContent = text;
  if (parent) parent.appendChild(node);
  return node;
}

function pushButton(parent, text, action) {
  const node = tag("button", "", parent, text);
  node.type = "button";
  node.addEventListener("click", action);
  return node;
}

// a colour of the style sheet, which depends on light, dark or paper
function ink(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function bytesOf(packed) {
  const text = atob(packed);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

function decode(packed) {
  return new Float32Array(bytesOf(packed).buffer);
}

function readable(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return value.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3);
}

// the place of the last of the rising xs that is not above x, or 0
function before(xs, x) {
  let lo = 0;
  let hi = xs.length;
  while (hi - lo > 1) {
    const middle = (lo + hi) >> 1;
    if (xs[middle] <= x) lo = middle;
    else hi = middle;
  }
  return lo;
}

function nearest(xs, x) {
  const lo = before(xs, x);
  const hi = Math.min(lo + 1, xs.length - 1);
  return x - xs[lo] <= xs[hi] - x ? lo : hi;
}
