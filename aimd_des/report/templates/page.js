"use strict";
// A slider says where it stands in words, for eyes and for screen readers.
for (const slider of document.querySelectorAll("input[data-values]")) {
  const values = JSON.parse(slider.dataset.values);
  const output = document.querySelector(`output[for="${slider.id}"]`);
  const tell = () => {
    output.textContent = values[Number(slider.value)];
    slider.setAttribute("aria-valuetext", output.textContent);
  };
  slider.addEventListener("input", tell);
  tell();
}
// The axis along which charts run is shown as a whole: its slider has nothing to choose.
const along = document.getElementById("along");
if (along) {
  const rest = () => {
    for (const slider of document.querySelectorAll("input[data-axis]")) {
      slider.disabled = slider.dataset.axis === along.value;
    }
  };
  along.addEventListener("change", rest);
  rest();
}
// Charts bind themselves to the controls; what is drawn when is theirs to know.
for (const place of document.querySelectorAll("[data-chart]")) {
  const spec = JSON.parse(document.getElementById(place.dataset.chart).textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
  const options = { renderer: "svg", actions: false, tooltip: { theme: dark ? "dark" : "light" } };
  vegaEmbed(place, spec, options).catch((error) => {
    place.textContent = `This chart cannot be drawn: ${error.message}`;
  });
}
