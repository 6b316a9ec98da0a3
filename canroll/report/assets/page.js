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
// with a workbench the plots over time wait for its range
for (const plot of shared.plots) if (!page.workbench || !plot.spec.linked) plot.draw();
if (page.playback) {
  const player = new Playback(document.getElementById("playback"), page.playback);
  window.addEventListener("resize", () => player.show(player.time));
}
const save = document.getElementById("save-json");
if (save) {
  const text = document.getElementById("result").textContent;
  save.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
}
const bench = page.workbench && new Workbench(document.getElementById("workbench"), page.workbench);
const started = bench ? bench.start() : Promise.resolve();
started.catch((error) => {
  bench.message.textContent = `This browser cannot unpack the recorded signals: ${error.message}`;
  drawAll();
}).then(() => { document.body.dataset.ready = "true"; });
