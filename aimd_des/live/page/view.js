// One system on the page: its ring, its charts and its table.

// What is seen of the past, in units of time.
const SPAN = 20;

class View {
  constructor(slot, place, chosen) {
    this.slot = slot;
    this.chosen = chosen;
    this.track = null;
    this.root = document.getElementById("system").content.firstElementChild.cloneNode(true);
    place.append(this.root);
    const find = (name) => this.root.querySelector(name);
    this.find = find;
    this.root.setAttribute("aria-label", `System ${slot.toUpperCase()}`);
    const sheet = (name) => new Sheet(find(name));
    this.ring = new Ring(sheet(".ring"));
    this.score = new Score(sheet(".score"));
    this.error = new ErrorChart(sheet(".error"));
    this.scatter = new Scatter(sheet(".scatter"));
    for (const one of [this.ring, this.score, this.error, this.scatter]) one.sheet.onfit = () => this.spoilt();
    find(".ring").addEventListener("click", (event) => {
      const box = event.currentTarget.getBoundingClientRect();
      const agent = this.track ? this.ring.agentAt(event.clientX - box.left, event.clientY - box.top, this.track.n) : -1;
      chosen.pick(agent === chosen.agent ? -1 : agent);
    });
    find(".agent").addEventListener("change", (event) => chosen.pick(Number(event.target.value)));
    this.shape = "";
    this.frames = 0;
  }

  // Take in what is played; tabs and rows follow if names have changed.
  begin(track) {
    this.track = track;
    const { start } = track, shape = JSON.stringify([start.resources, start.agents.length]);
    if (shape === this.shape) return;
    this.shape = shape;
    this.ring.scale = [];
    const tabs = this.find(".tabs");
    tabs.replaceChildren(...start.resources.map((resource, j) => this.tab(j, resource)));
    if (start.resources.length > 1) tabs.append(this.tab(-1, { name: "all" }));
    const none = new Option("none", "-1");
    this.find(".agent").replaceChildren(none, ...start.agents.map((name, i) => new Option(String(name), String(i))));
    this.buildSaws(start.resources);
    this.buildTable(start.resources);
    this.choose();
  }

  tab(value, resource) {
    const button = document.createElement("button");
    if (resource.colour) { const dot = document.createElement("i"); dot.style.background = shade(resource.colour); button.append(dot); }
    button.append(resource.name);
    button.dataset.resource = String(value);
    button.addEventListener("click", () => this.chosen.show(value));
    return button;
  }

  buildSaws(resources) {
    this.saws = resources.map((resource) => {
      const root = document.createElement("div");
      root.className = "saw";
      const head = document.createElement("div"), name = document.createElement("b"), words = document.createElement("span");
      head.className = "saw-head";
      const dot = document.createElement("i");
      dot.style.background = shade(resource.colour);
      name.append(dot, resource.name);
      head.append(name, words);
      const canvas = document.createElement("canvas");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Total demand for ${resource.name} against its capacity`);
      root.append(head, canvas);
      return { root, words, chart: null, canvas };
    });
    this.find(".saws").replaceChildren(...this.saws.map((saw) => saw.root));
    for (const saw of this.saws) {
      saw.chart = new Saw(new Sheet(saw.canvas));
      saw.chart.sheet.onfit = () => this.spoilt();
    }
  }

  buildTable(resources) {
    const heads = ["", "signals", "copies lost", "in flight", "cuts", "certain cuts", "averages use", "mis\u00adallocation"];
    const row = document.createElement("tr");
    row.append(...heads.map((text) => { const cell = document.createElement(text ? "th" : "td"); cell.textContent = text; if (text) cell.scope = "col"; return cell; }));
    this.find(".counts thead").replaceChildren(row);
    this.cells = resources.map((resource) => {
      const line = document.createElement("tr"), name = document.createElement("th"), dot = document.createElement("i");
      name.scope = "row";
      dot.style.background = shade(resource.colour);
      name.append(dot, resource.name);
      const cells = heads.slice(1).map(() => document.createElement("td"));
      line.append(name, ...cells);
      return { line, cells };
    });
    this.find(".counts tbody").replaceChildren(...this.cells.map((cell) => cell.line));
  }

  // A canvas that has another size is empty.
  spoilt() {
    this.stale = true;
    this.chosen.redraw();
  }

  // Show which resource and which agent are chosen.
  choose() {
    if (!this.track) return;
    const { resource, agent } = this.chosen;
    for (const button of this.find(".tabs").children) button.setAttribute("aria-pressed", String(Number(button.dataset.resource) === resource));
    this.find(".agent").value = String(agent < this.track.n ? agent : -1);
    const { resources } = this.track.start;
    const colour = resources[Math.max(0, resource)].colour;
    for (const mark of this.root.querySelectorAll(".disc, .bar")) mark.style.background = shade(colour);
    const name = resources[Math.max(0, resource)].name;
    this.find(".history-title").textContent = agent >= 0 && agent < this.track.n
      ? `Agent ${this.track.start.agents[agent]}: its demand for ${name} (dashed: its average), and below what came of each copy`
      : `${name}: from each signal (upright) to the arrival of its copies, a row for each agent`;
  }

  draw(time, options) {
    const { track } = this;
    if (!track || !track.frames.length) return;
    const { resource, agent } = this.chosen, { resources } = track.start;
    const shown = resource < 0 ? resources.map((_, j) => j) : [Math.min(resource, resources.length - 1)];
    const one = agent < track.n ? agent : -1;
    this.ring.draw(track, time, shown, { ...options, agent: one });
    this.score.draw(track, time, shown[0], one, SPAN);
    this.saws.forEach((saw, j) => saw.chart.draw(track, time, j, SPAN));
    // Numbers that change sixty times a second cannot be read.
    this.frames += 1;
    if (options.still || this.stale || this.frames % 8 === 0) {
      this.stale = false;
      this.error.draw(track, time);
      this.scatter.draw(track, time, one);
      this.tell(time);
    }
  }

  tell(time) {
    const { track } = this, { resources } = track.start, level = track.levelAt(time), frame = track.frameAt(time);
    const measure = track.measures[lastUpTo(track.measures, time, (one) => one.time)];
    resources.forEach((resource, j) => {
      const total = track.total(j, time, time, () => {}), capacity = level.capacity[j];
      const unit = resource.unit ? ` ${/^\d/.test(resource.unit) ? "× " : ""}${resource.unit}` : "";
      this.saws[j].words.textContent = `demand ${number(total)} of ${number(capacity)}${unit} (${percent(total / capacity, 0)})`;
      const counts = frame.counts.subarray(4 * j, 4 * j + 4), used = this.used(frame, j) / capacity;
      const texts = [
        number(counts[0], 6), number(counts[1], 6), number(this.flying(j, time), 6), number(counts[2], 6), number(counts[3], 6),
        percent(used), measure ? percent(measure.misallocation[j]) : "–",
      ];
      texts.forEach((text, k) => { this.cells[j].cells[k].textContent = text; });
    });
    this.find(".theory").textContent = track.band ? "Shaded: where theory expects 95 % of runs." : track.noBand;
    const lost = resources.reduce((sum, _, j) => sum + frame.counts[4 * j + 1], 0);
    this.find(".ring").setAttribute("aria-label", `Time ${time.toFixed(1)}: ${track.n} agents round the control unit, ${number(lost, 6)} copies lost so far`);
    this.find(".score").setAttribute("aria-label", this.find(".history-title").textContent);
    this.find(".error").setAttribute("aria-label", `Misallocation: ${resources.map((resource, j) => `${resource.name} ${measure ? percent(measure.misallocation[j]) : "not known"}`).join(", ")}`);
    this.find(".scatter").setAttribute("aria-label", "A point for each agent and resource: its average over the optimum for what is used");
  }

  used(frame, j) {
    let sum = 0;
    for (let i = j * this.track.n; i < (j + 1) * this.track.n; i++) sum += frame.average[i];
    return sum;
  }

  flying(j, time) {
    let count = 0;
    const list = this.track.signals[j];
    for (let k = list.length - 1; k >= 0; k--) {
      const signal = list[k];
      if (signal.time > time || signal.last <= time) { if (signal.time < time - 100) break; continue; }
      for (const raw of signal.arrival) if (raw > -1e8 && signal.base + raw > time) count += 1;
    }
    return count;
  }
}
