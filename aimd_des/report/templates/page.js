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

const save = (name, url) => {
  const link = document.createElement("a");
  link.download = name;
  link.href = url;
  link.click();
};
const saveText = (name, kind, text) => {
  const url = URL.createObjectURL(new Blob([text], { type: kind }));
  save(name, url);
  setTimeout(() => URL.revokeObjectURL(url), 10000);
};
// The rows that a chart draws, with the columns named as people know them.
const csv = (spec) => {
  const { rows, columns } = spec.usermeta;
  const named = Object.entries(columns);
  const quoted = (value) => {
    const text = value === undefined || value === null ? "" : String(value);
    return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const line = (cells) => cells.map(quoted).join(",");
  const cell = (row, [key, column]) => (column.values ? column.values[row[key]] : row[key]);
  const lines = spec.datasets[rows].map((row) => line(named.map((column) => cell(row, column))));
  return [line(named.map(([, column]) => column.name)), ...lines, ""].join("\r\n");
};
const savers = {
  CSV: async (name, spec) => saveText(`${name}.csv`, "text/csv", csv(spec)),
  SVG: async (name, _, view) => saveText(`${name}.svg`, "image/svg+xml", await view.toSVG()),
  PNG: async (name, _, view) => save(`${name}.png`, await view.toImageURL("png", 2)),
};

// Charts bind themselves to the controls; what is drawn when is theirs to know.
const views = new Map();
for (const place of document.querySelectorAll("[data-chart]")) {
  const name = place.dataset.chart;
  const spec = JSON.parse(document.getElementById(name).textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
  // Expressions are interpreted, not compiled: the page may forbid the evaluation of strings.
  const options = {
    // A window without a signal is no fault, and need not be warned of: 1 is the level of errors.
    logLevel: 1,
    renderer: "svg", actions: false, ast: true, tooltip: { theme: dark ? "dark" : "light" },
    loader: { target: "_self" },
  };
  vegaEmbed(place, spec, options).then(({ view }) => {
    views.set(place, view);
    const bar = document.querySelector(`[data-save="${name}"]`);
    for (const button of bar.querySelectorAll("button")) {
      button.addEventListener("click", () => savers[button.textContent](name, spec, view));
    }
    bar.hidden = false;
  }).catch((error) => {
    place.textContent = `This chart cannot be drawn: ${error.message}`;
  });
}
// On paper a chart is as wide as the text, and its letters are as large.
const PAPER = 640;
const fit = (width) => {
  for (const [place, view] of views) view.signal("width", width(place)).run();
};
window.addEventListener("beforeprint", () => fit(() => PAPER));
window.addEventListener("afterprint", () => fit((place) => place.clientWidth));

// A row that charts link to is shown, even if its table is closed.
const show = () => {
  const row = location.hash.length > 1 && document.getElementById(location.hash.slice(1));
  const table = row && row.closest("details");
  if (table) {
    table.open = true;
    row.scrollIntoView({ block: "center" });
    row.focus({ preventScroll: true });
  }
};
window.addEventListener("hashchange", show);
show();
// The runs of a point are listed below it when they are asked for.
for (const button of document.querySelectorAll("button[data-runs]")) {
  button.addEventListener("click", () => {
    const row = button.closest("tr");
    const open = button.getAttribute("aria-expanded") === "true";
    button.setAttribute("aria-expanded", String(!open));
    if (open) {
      row.nextElementSibling.remove();
      return;
    }
    const cell = document.createElement("td");
    cell.colSpan = row.cells.length;
    const list = document.createElement("ul");
    for (const run of JSON.parse(button.dataset.runs)) {
      list.append(Object.assign(document.createElement("li"), { textContent: run }));
    }
    cell.append(list);
    const added = document.createElement("tr");
    added.className = "listed";
    added.append(cell);
    row.after(added);
  });
}
