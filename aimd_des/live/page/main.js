// The page: plays, asks the server for runs, and keeps its state in the address.

// Where one begins: by then demand has reached the capacities.
const BEGIN = 40;
const boot = JSON.parse(document.getElementById("boot").textContent);
const byId = (id) => document.getElementById(id);
const recordedRun = boot.mode === "recorded";
const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

const app = {
  playing: false, speed: 1, time: BEGIN, resource: 0, agent: -1, two: false, slot: "a", when: "start",
  systems: { a: { start: {}, changes: [] }, b: { start: {}, changes: [] } },
  tracks: {}, ids: { a: 0, b: 0 }, asked: {}, waits: {}, views: {}, pending: null, dirty: true,
  stats: { frames: 0, pictures: {}, since: performance.now() },
  redraw() { app.dirty = true; },
  pick(agent) { app.agent = agent; choose(); },
  show(resource) { app.resource = resource; choose(); },
  change: (control, value, done) => changed(control, value, done),
};
window.live = app;

const slots = () => (app.two ? ["a", "b"] : ["a"]);
const copyOf = (value) => JSON.parse(JSON.stringify(value));

function choose() {
  for (const view of Object.values(app.views)) view.choose();
  app.redraw();
  remember();
}

// ---- what is asked of the server ----

let socket = null, waiting = [];

function connect() {
  const address = new URL("/socket", location.href);
  address.protocol = "ws:";
  address.search = location.search;
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("open", () => { for (const text of waiting) socket.send(text); waiting = []; });
  socket.addEventListener("message", (event) => take(typeof event.data === "string" ? JSON.parse(event.data) : unpack(event.data)));
  socket.addEventListener("close", () => { pause(); say("The server has ended. Start aimd-des live again, and open its new address.", true); });
}

function ask(wish) {
  const text = JSON.stringify(wish);
  if (socket.readyState === WebSocket.OPEN) socket.send(text); else waiting.push(text);
}

const lead = () => Math.max(1.5, 2 * app.speed);

// Run a system again: from the start, or with what is known up to a time.
function run(slot, keepUpTo = null) {
  const id = (app.ids[slot] += 1);
  const since = keepUpTo === null ? Math.max(0, Math.floor(app.time - SPAN)) : keepUpTo;
  app.waits[slot] = { id, keepUpTo, at: performance.now() };
  app.asked[slot] = Math.max(app.time, since) + lead();
  ask({ do: "run", slot, id, state: app.systems[slot], since, to: app.asked[slot] });
}

function more() {
  for (const slot of slots()) {
    const track = app.tracks[slot];
    if (!track || app.waits[slot] || track.over) continue;
    if (track.end - app.time < lead() && app.asked[slot] <= track.end + 1e-6) {
      app.asked[slot] = track.end + Math.max(0.5, app.speed);
      ask({ do: "more", slot, id: app.ids[slot], to: app.asked[slot] });
    }
  }
}

function take(message) {
  const { slot, kind } = message, wait = app.waits[slot];
  if (kind === "refused") { refused(message); return; }
  if (kind === "file") { download(message); return; }
  // What belongs to an earlier run, or to a system that is no longer shown, is of no use.
  if (message.id !== app.ids[slot] || !app.views[slot]) return;
  if (kind === "start") {
    if (wait.keepUpTo === null) wait.track = new Track(message);
  } else if (kind === "chunk") {
    if (wait) begin(slot, wait);
    if (!app.tracks[slot]) return;
    app.tracks[slot].add(message);
    if (wait) app.stats.pictures[slot] = { id: message.id, asked: wait.at, came: performance.now(), drawn: 0 };
  } else if (kind === "measure") measured(app.tracks[slot], message);
  else if (kind === "band") predicted(app.tracks[slot], message);
  app.redraw();
}

function begin(slot, wait) {
  if (wait.track) app.tracks[slot] = wait.track; else app.tracks[slot].cut(wait.keepUpTo);
  app.waits[slot] = null;
  say("");
  app.views[slot].begin(app.tracks[slot]);
  if (slot === app.slot) setControls();
  byId("title").textContent = app.tracks[slot].start.title;
}

function measured(track, message) {
  if (!track) return;
  const last = track.measures[track.measures.length - 1];
  if (!last || message.time > last.time) track.measures.push(message);
  if (message.best) track.best = message.best;
}

function predicted(track, message) {
  if (!track) return;
  if (message.time) track.band = message; else track.noBand = `No band: ${message.text}`;
}

function refused(message) {
  say(message.text, true);
  if (message.of === "run" && app.waits[message.slot]) {
    // What was there goes on: the refused wish is taken back.
    app.waits[message.slot] = null;
    if (app.good) { app.systems[message.slot] = copyOf(app.good[message.slot]); setControls(); }
  }
}

function download(message) {
  const anchor = document.createElement("a");
  anchor.href = URL.createObjectURL(new Blob([message.text], { type: message.type }));
  anchor.download = message.name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 10000);
  app.saved = message;
  say(`${message.name} is written: ${message.note || ""}`);
}

function say(text, bad = false) {
  const place = byId("message");
  if (place.textContent !== text) place.textContent = text;
  place.classList.toggle("bad", bad);
}

// ---- changes ----

// Where a control stands for the chosen system: as changed last, as chosen, or as it was at first.
function position(name) {
  const system = app.systems[app.slot], track = app.tracks[app.slot];
  for (let k = system.changes.length - 1; k >= 0; k--) {
    const { set } = system.changes[k];
    if (set && name in set) return set[name];
  }
  if (name in system.start && name !== "unit") return system.start[name];
  const shown = (track ? track.start : boot.start).shown[name];
  return shown === undefined ? null : shown;
}

const present = () => Math.ceil(app.time * 1000) / 1000;

function changed(control, value, done) {
  const system = app.systems[app.slot];
  app.good = app.good || copyOf(app.systems);
  if (app.when === "now" && control.now) {
    if (app.pending && app.pending.name === control.name) system.changes = system.changes.filter((one) => one !== app.pending.change);
    const change = { at: app.pending && app.pending.name === control.name ? app.pending.change.at : present(), set: { [control.name]: value } };
    goOn(app.slot, change);
    app.pending = done ? null : { name: control.name, change };
  } else {
    system.start[control.name] = value;
    if (control.name === "dynamics" && value === "discrete") system.start.unit = "sampled";
    run(app.slot);
  }
  setControls();
  remember();
}

// Let a change happen now: what comes after is another run.
function goOn(slot, change) {
  const system = app.systems[slot];
  // What was changed later belongs to a future that is not to be.
  system.changes = [...system.changes.filter((one) => one.at <= change.at), change];
  run(slot, change.at);
  listChanges();
  remember();
}

function setControls() {
  if (recordedRun) return;
  app.controls.set(position);
  listChanges();
}

const DONE = {
  capacity: (one, name) => `capacity of ${name} to ${Math.round(100 * one.to)} %`,
  leave: (one, _, agent) => `agent ${agent} leaves`,
  partition: () => "half of the agents hear nothing for 10",
  failover: () => "control unit down for 5",
};

function listChanges() {
  const { changes } = app.systems[app.slot], { start } = app.tracks[app.slot] || boot;
  byId("played").hidden = !changes.length;
  const words = (one) => (one.set
    ? Object.entries(one.set).map(([name, value]) => `${app.controls.rows.get(name).control.label} ${typeof value === "number" ? number(value) : value}`).join(", ")
    : DONE[one.do](one, start.resources[one.of] && start.resources[one.of].name, start.agents[one.of]));
  byId("changes").replaceChildren(...changes.map((one) => {
    const item = document.createElement("li"), button = document.createElement("button");
    button.textContent = "×";
    button.setAttribute("aria-label", `Forget: ${words(one)}`);
    button.addEventListener("click", () => {
      app.systems[app.slot].changes = changes.filter((other) => other !== one);
      run(app.slot);
      listChanges();
      remember();
    });
    item.append(button, `${number(one.at, 5)}: ${words(one)}`);
    return item;
  }));
}

function disturb(kind) {
  const { start } = app.tracks[app.slot], at = present(), resource = Math.max(0, app.resource), n = start.agents.length;
  if (kind === "capacity") goOn(app.slot, { at, do: "capacity", of: resource, to: 0.6 });
  if (kind === "restore") goOn(app.slot, { at, do: "capacity", of: resource, to: 1 });
  if (kind === "partition") goOn(app.slot, { at, do: "partition", for: 10, of: start.agents.map((_, i) => i).filter((i) => i % 2 === 0) });
  if (kind === "failover") goOn(app.slot, { at, do: "failover", for: 5 });
  if (kind === "leave") {
    const away = new Set(app.systems[app.slot].changes.filter((one) => one.do === "leave").map((one) => one.of));
    const here = start.agents.map((_, i) => i).filter((i) => !away.has(i));
    const of = app.agent >= 0 && !away.has(app.agent) ? app.agent : here[Math.floor(n / 3) % here.length];
    if (here.length > 1) goOn(app.slot, { at, do: "leave", of });
  }
}

// ---- playing ----

function play() {
  if (recordedRun && app.time >= app.tracks.a.end - 1e-9) app.time = boot.since;
  app.playing = true;
  showPlaying();
}

function pause() {
  app.playing = false;
  showPlaying();
  remember();
}

function showPlaying() {
  const button = byId("play");
  button.setAttribute("aria-pressed", String(app.playing));
  button.querySelector(".icon").textContent = app.playing ? "❚❚" : "▶";
  button.querySelector(".word").textContent = app.playing ? "Pause" : "Play";
}

function step(onlySignals) {
  pause();
  const found = Math.min(...slots().map((slot) => (app.tracks[slot] ? app.tracks[slot].nextEvent(app.time, onlySignals) : Infinity)));
  if (found < Infinity) { app.time = found + 1e-6; app.redraw(); remember(); }
}

function setSpeed(power) {
  app.speed = 10 ** power;
  byId("speed").value = String(power);
  const text = number(app.speed, 2);
  byId("speed-shown").textContent = text;
  byId("speed").setAttribute("aria-valuetext", `${text} units of time a second`);
}

let last = performance.now();

function tick(now) {
  const passed = Math.min(0.1, (now - last) / 1000);
  last = now;
  const shown = slots(), ready = shown.every((slot) => app.tracks[slot] && app.tracks[slot].frames.length);
  if (ready) {
    const held = shown.some((slot) => app.waits[slot] && app.waits[slot].keepUpTo !== null);
    if (app.playing && !held) {
      const before = app.time, end = Math.min(...shown.map((slot) => app.tracks[slot].end));
      app.time = Math.max(before, Math.min(before + passed * app.speed, end));
      if (app.time !== before) app.dirty = true;
      if (shown.every((slot) => app.tracks[slot].over) && app.time >= end) pause();
    }
    if (!recordedRun) more();
    if (app.dirty) { app.dirty = false; draw(shown); }
  }
  requestAnimationFrame(tick);
}

function draw(shown) {
  for (const slot of shown) {
    app.views[slot].draw(app.time, { speed: Math.max(0.25, Math.min(app.speed, 6)), calm: calm(), still: !app.playing });
    const picture = app.stats.pictures[slot];
    if (picture && !picture.drawn) picture.drawn = performance.now();
  }
  app.stats.frames += 1;
  const slider = byId("time"), ends = shown.map((slot) => app.tracks[slot]);
  const begin = Math.max(...ends.map((track) => track.begin)), end = Math.min(...ends.map((track) => track.end));
  slider.min = begin.toFixed(3);
  slider.max = end.toFixed(3);
  if (document.activeElement !== slider || app.playing) slider.value = String(app.time);
  const text = app.time.toFixed(1);
  byId("time-shown").textContent = text;
  slider.setAttribute("aria-valuetext", `time ${text}`);
  const { start } = ends[0];
  byId("subtitle").textContent = `${start.agents.length} agents, ${start.resources.length} resource${start.resources.length > 1 ? "s" : ""}, ${start.dynamics === "discrete" ? "agents that tick" : "continuous agents"}`;
}

// ---- the state, in the address ----

let remembering = 0;

function remember() {
  if (recordedRun) return;
  clearTimeout(remembering);
  remembering = setTimeout(() => {
    const state = { t: Number(app.time.toFixed(3)), v: Number(Math.log10(app.speed).toFixed(2)), r: app.resource, i: app.agent, a: app.systems.a };
    if (app.two) state.b = app.systems.b;
    history.replaceState(null, "", `${location.pathname}${location.search}#${encodeURIComponent(JSON.stringify(state))}`);
  }, 250);
}

function recall() {
  if (location.hash.length < 2) return;
  try {
    const state = JSON.parse(decodeURIComponent(location.hash.slice(1)));
    if (Number.isFinite(state.t)) app.time = Math.max(0, state.t);
    if (Number.isFinite(state.v)) setSpeed(Math.max(-1, Math.min(1.5, state.v)));
    if (Number.isInteger(state.r)) app.resource = Math.min(state.r, boot.start.resources.length - 1);
    if (Number.isInteger(state.i)) app.agent = state.i;
    for (const slot of ["a", "b"]) {
      const given = state[slot];
      if (given) app.systems[slot] = { start: { ...given.start }, changes: [...(given.changes || [])] };
    }
    setCompare(Boolean(state.b));
  } catch { say("The address holds no state that can be read: it begins anew.", true); }
}

// ---- side by side ----

function setCompare(two) {
  app.two = two;
  document.body.classList.toggle("two", two);
  byId("compare").setAttribute("aria-pressed", String(two));
  byId("which").hidden = !two;
  if (two && !app.views.b) app.views.b = new View("b", byId("systems"), app);
  if (!two && app.views.b) { app.views.b.root.remove(); delete app.views.b; delete app.tracks.b; app.waits.b = null; app.ids.b += 1; app.slot = "a"; }
  for (const [slot, view] of Object.entries(app.views)) view.find(".name").textContent = two ? `System ${slot.toUpperCase()}` : "";
  selectSlot(app.slot);
}

function selectSlot(slot) {
  app.slot = slot;
  for (const button of byId("which").children) button.setAttribute("aria-pressed", String(button.dataset.slot === slot));
  if (app.tracks[slot]) setControls();
}

// ---- the beginning ----

function listen() {
  byId("play").addEventListener("click", () => (app.playing ? pause() : play()));
  byId("next-event").addEventListener("click", () => step(false));
  byId("next-signal").addEventListener("click", () => step(true));
  byId("speed").addEventListener("input", (event) => { setSpeed(Number(event.target.value)); remember(); });
  byId("time").addEventListener("input", (event) => { pause(); app.time = Number(event.target.value); app.redraw(); });
  document.addEventListener("keydown", keys);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
}

function keys(event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const tag = event.target.tagName;
  if (tag === "SELECT" || (tag === "INPUT" && event.target.type === "text")) return;
  if (event.key === " " && tag !== "BUTTON" && tag !== "INPUT") { event.preventDefault(); if (app.playing) pause(); else play(); }
  if (event.key === "e") step(false);
  if (event.key === "s") step(true);
  if (event.key === "Escape" && app.agent >= 0) app.pick(-1);
}

function recolour() {
  readPalette();
  for (const view of Object.values(app.views)) { view.shape = ""; if (view.track) view.begin(view.track); }
  app.redraw();
}

function listenLive() {
  byId("compare").addEventListener("click", () => {
    if (!app.two) app.systems.b = copyOf(app.systems.a);
    setCompare(!app.two);
    if (app.two) { selectSlot("b"); run("b"); }
    remember();
  });
  byId("which").addEventListener("click", (event) => { if (event.target.dataset.slot) selectSlot(event.target.dataset.slot); });
  byId("when").addEventListener("change", (event) => { app.when = event.target.value; byId("controls").classList.toggle("now", app.when === "now"); });
  for (const button of document.querySelectorAll("[data-do]")) button.addEventListener("click", () => disturb(button.dataset.do));
  byId("undo-all").addEventListener("click", () => { app.systems[app.slot].changes = []; run(app.slot); setControls(); remember(); });
  byId("reset").addEventListener("click", () => { app.systems[app.slot] = { start: {}, changes: [] }; run(app.slot); remember(); });
  byId("link").addEventListener("click", async () => {
    remember();
    await new Promise((done) => { setTimeout(done, 300); });
    await navigator.clipboard.writeText(location.href).then(() => say("The address of this state is copied."), () => say("The address bar holds this state."));
  });
  byId("save").addEventListener("click", () => ask({ do: "save", slot: app.slot, id: 0, state: app.systems[app.slot], to: Math.ceil(app.time) }));
  byId("export").addEventListener("click", () => {
    pause();
    say("Recording …");
    ask({ do: "export", slot: app.slot, id: 0, state: app.systems[app.slot], since: Math.max(0, Math.floor(app.time - 40)), to: Math.ceil(app.time) });
  });
  addEventListener("hashchange", () => { recall(); for (const slot of slots()) run(slot); });
}

async function startRecorded() {
  document.body.classList.add("recorded");
  const track = new Track(boot.start);
  app.tracks.a = track;
  app.time = Math.min(boot.since + SPAN, boot.to);
  for (const text of boot.messages) {
    const message = unpack(await inflate(text));
    if (message.kind === "chunk") track.add(message); else measured(track, message);
  }
  byId("title").textContent = boot.start.title;
  app.views.a.begin(track);
  if (boot.band) predicted(track, boot.band);
}

async function main() {
  readPalette();
  app.views.a = new View("a", byId("systems"), app);
  listen();
  setSpeed(0);
  if (recordedRun) await startRecorded();
  else {
    app.controls = new Controls(boot.controls, byId("groups"), app);
    listenLive();
    recall();
    setControls();
    connect();
    say("Computing …");
    for (const slot of slots()) run(slot);
  }
  if (!calm()) play();
  requestAnimationFrame(tick);
}

main();
