// One time for all that the page shows: scene, values, and the cursor in the plots.
const $ = (id) => document.getElementById(id);
const slider = $("time");
const scene = $("scene");
const legend = JSON.parse($("legend").textContent); // [name, label, color] of each estimator.
let now = 0;
let values = { times: [], rows: [] };
let playedAt = null; // Of the last frame while it plays, [ms].

function goTo(time) {
  now = Math.min(Math.max(time, 0), Number(slider.max));
  slider.value = now;
  $("now").textContent = `${now.toFixed(2)} s`;
  scene?.contentWindow.postMessage(now, "*");
  showValues();
  document.querySelectorAll(".plot").forEach(placeCursors);
}

function lastUntil(end) {
  slider.max = Math.max(Number(slider.max), end);
  $("end").textContent = `of ${Number(slider.max).toFixed(2)} s`;
}

// --- Values -------------------------------------------------------------------------------------

function written(value, deviation) {
  if (value === null || value === undefined) return "-";
  const known = deviation !== null && deviation !== undefined && deviation > 0;
  const scale = known ? deviation : Math.abs(value) / 10; // Of it two digits are shown.
  if (scale < 1e-7) return "0";
  const places = Math.min(Math.max(1 - Math.floor(Math.log10(scale)), 0), 6);
  return value.toFixed(places) + (known ? ` ± ${deviation.toFixed(places)}` : "");
}

function tickAt(time) {
  const later = values.times.findIndex((one) => one > time + 1e-6);
  return later < 0 ? values.times.length - 1 : Math.max(later - 1, 0);
}

function makeTable() {
  const body = $("values").tBodies[0];
  for (const row of values.rows) {
    const line = body.insertRow();
    line.insertCell().textContent = [row.quantity.replaceAll("_", " "), row.component]
      .filter(Boolean)
      .join(", ");
    for (let column = 0; column <= legend.length; column += 1) line.insertCell();
  }
}

function showValues() {
  if (!values.rows.length) return;
  const tick = tickAt(now);
  values.rows.forEach((row, index) => {
    const cells = $("values").tBodies[0].rows[index].cells;
    legend.forEach(([name], column) => {
      const series = row.series[name];
      const text = series ? written(series.estimate[tick], series.std[tick]) : "";
      cells[column + 1].textContent = text;
    });
    cells[legend.length + 1].textContent = row.truth.some((one) => one !== null)
      ? written(row.truth[tick])
      : "";
  });
}

// --- Plots --------------------------------------------------------------------------------------

const percent = (share) => `${100 * share}%`;

function addPlot(plot, panels) {
  plot.panels = panels;
  for (const [, , top, bottom] of panels) {
    const cursor = document.createElement("div");
    cursor.className = "cursor";
    cursor.style.top = percent(top);
    cursor.style.height = percent(bottom - top);
    plot.append(cursor);
  }
  plot.addEventListener("click", (event) => {
    const box = plot.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width;
    const y = (event.clientY - box.top) / box.height;
    for (const [left, right, top, bottom, first, last] of panels) {
      if (left <= x && x <= right && top <= y && y <= bottom) {
        stop();
        goTo(first + ((x - left) / (right - left)) * (last - first));
      }
    }
  });
  placeCursors(plot);
}

function placeCursors(plot) {
  plot.querySelectorAll(".cursor").forEach((cursor, index) => {
    const [left, right, , , first, last] = plot.panels[index];
    cursor.hidden = now < first || now > last;
    cursor.style.left = percent(left + ((now - first) / (last - first)) * (right - left));
  });
}

async function draw(details) {
  const plot = details.querySelector(".plot");
  if (!details.open || plot.panels) return;
  plot.panels = [];
  const answer = await fetch(`/plots/${encodeURIComponent(details.dataset.quantity)}`);
  const { image, panels } = await answer.json();
  const picture = document.createElement("img");
  picture.src = image;
  picture.alt = `${details.dataset.quantity} over time`;
  plot.replaceChildren(picture);
  addPlot(plot, panels);
}

// --- Playing ------------------------------------------------------------------------------------

function stop() {
  playedAt = null;
  $("play").textContent = "Play";
}

function step(frame) {
  if (playedAt === null) return;
  goTo(now + (Number($("speed").value) * (frame - playedAt)) / 1000);
  if (now >= Number(slider.max)) return stop();
  playedAt = frame;
  requestAnimationFrame(step);
}

function play() {
  if (playedAt !== null) return stop();
  if (now >= Number(slider.max)) goTo(0);
  $("play").textContent = "Pause";
  playedAt = performance.now();
  requestAnimationFrame(step);
}

// --- Wiring -------------------------------------------------------------------------------------

$("play").addEventListener("click", play);
slider.addEventListener("input", () => {
  stop();
  goTo(Number(slider.value));
});
document.querySelectorAll("[data-time]").forEach((button) =>
  button.addEventListener("click", () => {
    stop();
    goTo(Number(button.dataset.time));
  }),
);
document.querySelectorAll(".plot[data-panels]").forEach((plot) => {
  addPlot(plot, JSON.parse(plot.dataset.panels));
});
document.querySelectorAll("details[data-quantity]").forEach((details) => {
  details.addEventListener("toggle", () => draw(details));
  draw(details);
});
addEventListener("message", ({ source, data }) => {
  if (!scene || source !== scene.contentWindow) return;
  if (Number.isFinite(data?.duration)) {
    lastUntil(data.duration);
    scene.dataset.ready = "yes";
    goTo(now);
  } else if (data?.missing) {
    const line = document.createElement("p");
    line.className = "warning";
    line.textContent =
      "The scene does not move: in meshcat.html there is no animation that this version knows.";
    scene.before(line);
  }
});
document.querySelectorAll("[data-time]").forEach((button) => lastUntil(Number(button.dataset.time)));
fetch("/estimates.json")
  .then((answer) => answer.json())
  .then((found) => {
    values = found;
    makeTable();
    if (values.times.length) lastUntil(values.times.at(-1));
    goTo(0);
  });
