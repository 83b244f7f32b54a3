"use strict";
// Change between A and B: the same map of the other result, over the whole picture.

function toggleResult() {
  const [, what, which] = /^(.*) ([AB])$/.exec(choices.right.value) || ["", "albedo", "B"];
  slider.moveTo(0);
  chooseMap("right", `${what} ${which === "A" ? "B" : "A"}`);
}

document.getElementById("toggle").addEventListener("click", toggleResult);
document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("select, canvas, input:not([type=range])");
  if (!typing && !event.ctrlKey && !event.metaKey && !event.altKey && event.key.toLowerCase() === "t") toggleResult();
});
