// The controls: made of what the server says of them, and set to where the system stands.

const SHOWN = {
  "%": (value) => `${Math.round(100 * value)} %`,
  "": (value) => number(value, 4),
};

class Controls {
  constructor(groups, place, chosen) {
    this.chosen = chosen;
    this.rows = new Map();
    for (const group of groups) {
      const section = document.createElement("section");
      section.className = "group";
      const title = document.createElement("h2");
      title.textContent = group.title;
      section.append(title, ...group.controls.map((control) => this.row(control)));
      place.append(section);
    }
  }

  row(control) {
    const root = document.createElement("div"), label = document.createElement("label"), output = document.createElement("output");
    root.className = "control";
    const id = `control-${control.name}`;
    label.htmlFor = id;
    label.textContent = control.label;
    output.htmlFor = id;
    const input = document.createElement(control.kind === "slider" ? "input" : "select");
    input.id = id;
    if (control.kind === "slider") {
      input.type = "range";
      Object.assign(input, { min: control.low, max: control.high, step: control.step });
      input.addEventListener("input", () => this.moved(control, Number(input.value), false));
      input.addEventListener("change", () => this.moved(control, Number(input.value), true));
    } else {
      input.append(...control.options.map(([value, text]) => new Option(text, value)));
      const other = new Option("as in the file", "");
      other.hidden = true;
      input.append(other);
      input.addEventListener("change", () => this.moved(control, input.value, true));
    }
    root.append(label, output, input);
    if (!control.now) {
      const note = document.createElement("span");
      note.className = "from-start";
      note.textContent = "from the start only";
      root.append(note);
    }
    this.rows.set(control.name, { control, root, input, output });
    return root;
  }

  moved(control, value, done) {
    this.say(this.rows.get(control.name), value);
    this.chosen.change(control, value, done);
  }

  say({ control, input, output }, value) {
    if (control.kind !== "slider") return;
    const text = value === null ? "as in the file" : control.name === "burst" && !value ? "none" : SHOWN[control.unit](value);
    output.textContent = text;
    input.setAttribute("aria-valuetext", text);
  }

  // Set all controls to where a system stands, but the one that is being moved.
  set(position) {
    const unit = position("unit"), discrete = position("dynamics") === "discrete";
    for (const [name, row] of this.rows) {
      const value = position(name);
      const idle = (name === "hold_off" && unit === "sampled") || (name === "period" && unit === "crossing")
        || (name === "clocks" && !discrete) || (name === "count" && value === null)
        || (name === "burst" && !position("loss")) || (name === "latency_kind" && !position("latency"));
      row.root.hidden = idle;
      if (row.control.name === "unit") {
        row.input.querySelector('[value="crossing"]').disabled = discrete;
      }
      if (document.activeElement === row.input && row.control.kind === "slider") continue;
      row.input.value = value === null ? "" : String(value);
      this.say(row, value);
    }
  }
}
