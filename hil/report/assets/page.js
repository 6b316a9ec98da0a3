"use strict";
// Puts the plots and the playback of the embedded data on the page.

const page = JSON.parse(document.getElementById("data").textContent);
for (const group of document.querySelectorAll("[data-figures]")) {
  for (const spec of page.figures.filter((f) => f.group === group.dataset.figures)) {
    const figure = tag("figure", "", group);
    figure.id = `figure-${spec.id}`;
    new Plot(figure, spec);
  }
}
drawAll();
if (page.playback) {
  const player = new Playback(document.getElementById("playback"), page.playback);
  window.addEventListener("resize", () => player.show(player.time));
}
window.addEventListener("resize", drawAll);
window.addEventListener("beforeprint", drawAll);
const save = document.getElementById("save-json");
if (save) {
  const text = document.getElementById("result").textContent;
  save.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
}
document.body.dataset.ready = "true";
