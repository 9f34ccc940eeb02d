// What is known of a run: messages are unpacked, and put one behind the other.

function unpack(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  let at = 4 + size;
  const arrays = {};
  for (const [name, [kind, shape]] of Object.entries(head.arrays)) {
    const length = shape.reduce((product, side) => product * side, 1);
    arrays[name] = kind === "f" ? new Float32Array(buffer, at, length) : new Int32Array(buffer, at, length);
    at += 4 * length;
  }
  return { ...head, ...arrays };
}

async function inflate(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// The place of the last element whose key is not above a value; -1 where there is none.
function lastUpTo(list, value, key) {
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (key(list[middle]) <= value) low = middle + 1; else high = middle;
  }
  return low - 1;
}

// How far back a page remembers what happened to each copy, in units of time.
const MEMORY = 400;

class Track {
  constructor(start) {
    this.start = start;
    this.n = start.agents.length;
    this.m = start.resources.length;
    this.continuous = start.dynamics === "continuous";
    this.chunks = [];
    this.frames = [];
    this.signals = start.resources.map(() => []);
    this.byNumber = new Map();
    this.levels = [];
    this.notes = [];
    this.measures = [];
    this.best = null;
    this.band = null;
    this.noBand = "";
    this.over = false;
  }

  get begin() { return this.chunks.length ? this.chunks[0].from : 0; }
  get end() { return this.chunks.length ? this.chunks[this.chunks.length - 1].to : 0; }

  // Forget all from a time on: another future takes its place.
  cut(time) {
    this.chunks = this.chunks.filter((chunk) => chunk.from < time);
    for (const chunk of this.chunks) {
      if (chunk.to > time) { chunk.to = time; chunk.cut = time; }
    }
    this.frames = this.frames.filter((frame) => frame.time < time);
    for (const list of this.signals) {
      while (list.length && list[list.length - 1].time >= time) this.byNumber.delete(list.pop().key);
      for (const signal of list) {
        for (let i = 0; i < this.n; i++) if (signal.base + signal.arrival[i] >= time) signal.answer[i] = NaN;
      }
    }
    this.levels = this.levels.filter((level) => level.time < time);
    this.notes = this.notes.filter((note) => note.time < time);
    this.measures = this.measures.filter((measure) => measure.time < time);
    this.band = null;
    this.noBand = "";
    this.over = false;
  }

  add(chunk) {
    const { n, m } = this;
    chunk.cut = Infinity;
    this.chunks.push(chunk);
    this.over = chunk.over;
    this.levels.push({ time: chunk.from, capacity: chunk.capacity, limit: chunk.limit });
    this.addNotes(chunk);
    for (let k = 0; k < chunk.frame.length; k++) {
      const part = (array, width) => array.subarray(k * width, (k + 1) * width);
      this.frames.push({
        time: chunk.from + chunk.frame[k], chunk,
        demand: part(chunk.demand, m * n), average: part(chunk.average, m * n), counts: part(chunk.counts, m * 4),
      });
    }
    for (let k = 0; k < chunk.signal.length; k++) {
      const [resource, number, copy] = chunk.sent.subarray(3 * k, 3 * k + 3);
      const arrival = chunk.arrival.subarray(k * n, (k + 1) * n);
      const key = `${resource} ${number}`;
      const time = chunk.from + chunk.signal[k];
      const answer = copy ? null : new Float32Array(n).fill(NaN);
      let arrived = 0, sum = 0;
      for (const when of arrival) if (when > -1e8) { arrived += 1; sum += when - chunk.signal[k]; }
      const signal = { key, time, number, copy, arrival, base: chunk.from, answer, mean: arrived ? sum / arrived : 0 };
      signal.last = time;
      for (const when of arrival) if (chunk.from + when > signal.last) signal.last = chunk.from + when;
      if (copy) signal.answer = (this.byNumber.get(key) || { answer: new Float32Array(n).fill(NaN) }).answer;
      else this.byNumber.set(key, signal);
      this.signals[resource].push(signal);
    }
    for (let k = 0; k < chunk.answered.length / 3; k++) {
      const [resource, agent, number] = chunk.answered.subarray(3 * k, 3 * k + 3);
      const signal = this.byNumber.get(`${resource} ${number}`);
      if (signal) signal.answer[agent] = chunk.answer[2 * k + 1];
    }
    this.forget();
  }

  addNotes(chunk) {
    for (const [time, kind, resource, agent, value] of chunk.notes) {
      this.notes.push({ time, kind, resource, agent, value });
      const last = this.levels[this.levels.length - 1];
      if (kind === "capacity" || kind === "threshold") {
        const level = { time, capacity: [...last.capacity], limit: [...last.limit] };
        const share = last.limit[resource] / last.capacity[resource];
        if (kind === "capacity") level.capacity[resource] = value;
        level.limit[resource] = (kind === "threshold" ? value : share) * level.capacity[resource];
        this.levels.push(level);
      }
    }
  }

  forget() {
    const limit = this.end - MEMORY;
    if (this.chunks.length < 50 || this.chunks[0].to > limit) return;
    this.chunks = this.chunks.filter((chunk) => chunk.to > limit);
    const begin = this.begin;
    this.frames = this.frames.filter((frame) => frame.time >= begin);
    for (const list of this.signals) {
      while (list.length && list[0].last < begin) this.byNumber.delete(list.shift().key);
    }
  }

  levelAt(time) { return this.levels[Math.max(0, lastUpTo(this.levels, time, (level) => level.time))]; }

  frameAt(time) { return this.frames[Math.max(0, lastUpTo(this.frames, time, (frame) => frame.time))]; }

  // Demand of all agents for one resource at a time, and their averages between two frames.
  agentsAt(time, resource) {
    const { n } = this, from = resource * n;
    const place = Math.max(0, lastUpTo(this.frames, time, (frame) => frame.time));
    const frame = this.frames[place], next = this.frames[place + 1];
    const demand = Float32Array.from(frame.demand.subarray(from, from + n));
    const average = Float32Array.from(frame.average.subarray(from, from + n));
    if (this.continuous) {
      const chunk = frame.chunk, span = time - frame.time;
      for (let i = 0; i < n; i++) demand[i] += chunk.increase[from + i] * span;
      const first = frame.time - chunk.from, last = time - chunk.from;
      const { answer, answered } = chunk;
      for (let k = 0; k < answered.length / 3; k++) {
        const when = answer[2 * k];
        if (when > last) break;
        if (when > first && answered[3 * k] === resource && answer[2 * k + 1] > 0) demand[answered[3 * k + 1]] -= answer[2 * k + 1];
      }
      for (let i = 0; i < n; i++) if (demand[i] < 0) demand[i] = 0;
    }
    if (next && next.time > frame.time) {
      const share = Math.min(1, (time - frame.time) / (next.time - frame.time));
      for (let i = 0; i < n; i++) average[i] += share * (next.average[from + i] - average[i]);
    }
    return { demand, average };
  }

  // Corners of total demand for one resource from one time to another, in order; returns what it is at the end.
  total(resource, since, until, visit) {
    let t = NaN, v = NaN, begun = false;
    const between = (time, value, at) => (time > t ? v + ((value - v) * (at - t)) / (time - t) : value);
    for (const chunk of this.chunks) {
      if (chunk.to < since) continue;
      for (let k = chunk.place[resource]; k < chunk.place[resource + 1]; k++) {
        const time = chunk.from + chunk.total[2 * k], value = chunk.total[2 * k + 1];
        if (time > chunk.cut) break;
        if (time >= since && !begun) {
          begun = true;
          if (t < since && time <= until) visit(since, between(time, value, since));
        }
        if (time > until) {
          const last = between(time, value, until);
          visit(until, last);
          return last;
        }
        if (begun) visit(time, value);
        t = time;
        v = value;
      }
    }
    return v;
  }

  // The hold-off of the control unit at a time; null where it has none.
  holdOffAt(time) {
    let found = this.start.shown.unit === "crossing" ? this.start.shown.hold_off : null;
    for (const note of this.notes) if (note.kind === "hold_off" && note.time <= time) found = note.value;
    return found;
  }

  // The first event after a time: a signal, an arrival, a change from outside, or a tick.
  nextEvent(time, onlySignals) {
    let found = Infinity;
    for (const list of this.signals) {
      for (let k = list.length - 1; k >= 0; k--) {
        const signal = list[k];
        if (signal.time > time && signal.time < found) found = signal.time;
        if (!onlySignals && signal.time < found && signal.last > time) {
          for (let i = 0; i < this.n; i++) {
            const when = signal.base + signal.arrival[i];
            if (when > time && when < found) found = when;
          }
        }
        if (signal.time < time - MEMORY) break;
      }
    }
    if (!onlySignals) for (const note of this.notes) if (note.time > time && note.time < found) found = note.time;
    return found <= this.end ? found : Infinity;
  }
}
