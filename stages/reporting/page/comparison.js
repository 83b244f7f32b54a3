"use strict";
// Two pictures over one another: the slider, and a drag on the picture, move the line between them.

function connectSlider(root) {
  const slider = root.querySelector("input[type=range]");
  const show = () => root.style.setProperty("--at", `${slider.value}%`);
  slider.addEventListener("input", show);
  show();
  return {
    moveTo(share) {
      slider.value = String(100 * Math.min(1, Math.max(0, share)));
      show();
    },
  };
}

function connectBest(root) {
  const comparison = connectSlider(root);
  const pane = root.querySelector(".pane");
  const picture = pane.querySelector("img");
  const width = Number(picture.getAttribute("width"));
  const height = Number(picture.getAttribute("height"));
  root.style.setProperty("--shape", `${width} / ${height}`);
  root.parentElement.style.setProperty("--ratio", String(width / height));
  const follow = (event) => {
    const box = pane.getBoundingClientRect();
    comparison.moveTo((event.clientX - box.left) / box.width);
  };
  pane.addEventListener("pointerdown", (event) => {
    pane.setPointerCapture(event.pointerId);
    follow(event);
  });
  pane.addEventListener("pointermove", (event) => {
    if (pane.hasPointerCapture(event.pointerId)) follow(event);
  });
}

connectBest(document.querySelector(".best .comparison"));
