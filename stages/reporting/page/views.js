"use strict";
// One view at a time: its maps, the slider between two of them, one zoom and one position for all of them.

const report = JSON.parse(document.getElementById("data").textContent);
const viewer = document.getElementById("viewer");
const large = document.getElementById("large");
const pane = large.querySelector(".pane");
const caption = document.getElementById("large-caption");
const choices = {
  view: document.getElementById("which-view"),
  left: document.getElementById("left-kind"),
  right: document.getElementById("right-kind"),
};
const maps = [...viewer.querySelectorAll(".maps button")];
const largest = 40; // times
const slider = connectSlider(large);
const shown = { view: 0, zoom: 1, x: 0, y: 0 }; // x, y: of the picture's corner, in widths and heights of it

function describe(kind, view) {
  const range = kind === "depth" && view.depth ? ` (${view.depth.map((z) => z.toPrecision(3)).join(" to ")})` : "";
  return `${kind}${range}`;
}

function picture(image, view, kind) {
  image.src = view.pictures[kind] || view.pictures.photo;
  image.alt = `${kind} of view ${view.name}: ${report.kinds[kind]}`;
}

function showMaps() {
  const view = report.views[shown.view];
  for (const side of ["left", "right"]) {
    if (!view.pictures[choices[side].value]) choices[side].value = "photo";
    picture(large.querySelector(`.${side} img`), view, choices[side].value);
  }
  for (const map of maps) {
    map.hidden = !view.pictures[map.dataset.kind];
    if (!map.hidden) picture(map.querySelector("img"), view, map.dataset.kind);
    map.setAttribute("aria-pressed", String(map.dataset.kind === choices.right.value));
  }
  const sides = [choices.left.value, choices.right.value];
  caption.textContent = `${sides.map((kind) => describe(kind, view)).join(" | ")} · view ${view.name}`;
  document.getElementById("about-view").textContent =
    `${view.about} ${sides.map((kind) => `${kind[0].toUpperCase()}${kind.slice(1)}: ${report.kinds[kind]}.`).join(" ")}`;
}

function showView(number) {
  shown.view = (number + report.views.length) % report.views.length;
  choices.view.value = String(shown.view);
  const [width, height] = report.views[shown.view].size;
  viewer.style.setProperty("--shape", `${width} / ${height}`);
  viewer.style.setProperty("--ratio", String(width / height));
  for (const link of document.querySelectorAll(".thumbnails a")) {
    if (link.hash === `#view-${shown.view + 1}`) link.setAttribute("aria-current", "true");
    else link.removeAttribute("aria-current");
  }
  showMaps();
  document.dispatchEvent(new CustomEvent("view", { detail: shown.view }));
}

// zoom and position

function place(zoom, x, y) {
  shown.zoom = Math.min(largest, Math.max(1, zoom));
  shown.x = Math.min(0, Math.max(1 - shown.zoom, x));
  shown.y = Math.min(0, Math.max(1 - shown.zoom, y));
  viewer.classList.toggle("zoomed", shown.zoom > 1);
  viewer.style.setProperty("--zoom", String(shown.zoom));
  viewer.style.setProperty("--x", `${100 * shown.x}%`);
  viewer.style.setProperty("--y", `${100 * shown.y}%`);
}

function zoomBy(factor, u = 0.5, v = 0.5) {
  const zoom = Math.min(largest, Math.max(1, shown.zoom * factor));
  const ratio = zoom / shown.zoom;
  place(zoom, u - (u - shown.x) * ratio, v - (v - shown.y) * ratio);
}

function spot(event) {
  const box = pane.getBoundingClientRect();
  return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
}

const fingers = new Map();

pane.addEventListener("pointerdown", (event) => {
  fingers.set(event.pointerId, spot(event));
  pane.setPointerCapture(event.pointerId);
});

pane.addEventListener("pointermove", (event) => {
  if (!fingers.has(event.pointerId)) return;
  const [u, v] = spot(event);
  const [before, beside] = [fingers.get(event.pointerId), [...fingers].find(([id]) => id !== event.pointerId)];
  if (beside) {
    const [p, q] = beside[1];
    const apart = Math.hypot(u - p, v - q) / Math.max(Math.hypot(before[0] - p, before[1] - q), 0.01);
    zoomBy(apart, (u + p) / 2, (v + q) / 2);
  } else if (shown.zoom > 1) {
    place(shown.zoom, shown.x + u - before[0], shown.y + v - before[1]);
  } else {
    slider.moveTo(u);
  }
  fingers.set(event.pointerId, [u, v]);
});

for (const end of ["pointerup", "pointercancel"]) {
  pane.addEventListener(end, (event) => fingers.delete(event.pointerId));
}

pane.addEventListener("dblclick", (event) => {
  if (shown.zoom > 1) place(1, 0, 0);
  else zoomBy(3, ...spot(event));
});

pane.addEventListener("wheel", (event) => {
  if (!event.ctrlKey && !event.metaKey) return; // the page scrolls
  event.preventDefault();
  zoomBy(Math.exp(-event.deltaY / 300), ...spot(event));
}, { passive: false });

// controls and keys

choices.view.addEventListener("change", () => go(Number(choices.view.value)));
for (const side of ["left", "right"]) choices[side].addEventListener("change", showMaps);
for (const map of maps) map.addEventListener("click", () => chooseMap("right", map.dataset.kind));
document.getElementById("previous").addEventListener("click", () => go(shown.view - 1));
document.getElementById("next").addEventListener("click", () => go(shown.view + 1));
document.getElementById("zoom-in").addEventListener("click", () => zoomBy(1.5));
document.getElementById("zoom-out").addEventListener("click", () => zoomBy(1 / 1.5));
document.getElementById("zoom-reset").addEventListener("click", () => place(1, 0, 0));

function chooseMap(side, kind) {
  if (!report.views[shown.view].pictures[kind]) return;
  choices[side].value = kind;
  showMaps();
}

function go(number) {
  showView(number);
  history.replaceState(null, "", `#view-${shown.view + 1}`);
}

function movePicture(event) {
  const steps = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
  const step = steps[event.key];
  if (!step || shown.zoom === 1) return;
  event.preventDefault();
  place(shown.zoom, shown.x + step[0], shown.y + step[1]);
}

pane.tabIndex = 0;
pane.setAttribute("role", "group");
pane.setAttribute("aria-label", "Picture; arrows move it where it is enlarged");
pane.addEventListener("keydown", movePicture);

document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("select, canvas, input:not([type=range])");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  const digit = /^Digit([1-9])$/.exec(event.code);
  const actions = {
    n: () => go(shown.view + 1),
    p: () => go(shown.view - 1),
    "+": () => zoomBy(1.5),
    "=": () => zoomBy(1.5),
    "-": () => zoomBy(1 / 1.5),
    0: () => place(1, 0, 0),
  };
  const action = actions[event.key.toLowerCase()];
  if (action) action();
  else if (digit && maps[digit[1] - 1]) chooseMap(event.shiftKey ? "left" : "right", maps[digit[1] - 1].dataset.kind);
});

function followLink() {
  const wanted = /^#view-(\d+)(?:-([a-z]+))?$/.exec(location.hash); // a view, and the map on the right
  if (!wanted || Number(wanted[1]) > report.views.length) return false;
  showView(Number(wanted[1]) - 1);
  if (wanted[2]) chooseMap("right", wanted[2]);
  document.getElementById("views").scrollIntoView();
  return true;
}

window.addEventListener("hashchange", followLink);
if (!followLink()) showView(0);
