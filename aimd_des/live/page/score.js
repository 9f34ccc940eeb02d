// What has happened to copies: a row for each agent, or the line of one of them.

// So many rows can be told apart.
const MOST_ROWS = 120;

class Score {
  constructor(sheet) { this.sheet = sheet; }

  draw(track, time, resource, agent, span) {
    if (!this.sheet.begin()) return;
    this.left = 6;
    this.right = this.sheet.width - 6;
    this.x = (when) => this.left + ((when - time + span) / span) * (this.right - this.left);
    if (agent >= 0) this.ofOne(track, time, resource, agent, span); else this.ofAll(track, time, resource, span);
  }

  // From the signal to the arrival of each copy: a line, a dot where it arrives, a cross where it is lost.
  ofAll(track, time, resource, span) {
    const { context, height } = this.sheet, { n } = track, { x } = this;
    const every = Math.ceil(n / MOST_ROWS), rows = Math.ceil(n / every), row = (height - 10) / rows;
    const size = Math.max(1.1, Math.min(2.4, row * 0.42)), since = time - span;
    const flights = new Path2D(), cutFlights = new Path2D(), dots = new Path2D(), cuts = new Path2D(), lost = new Path2D(), sent = new Path2D();
    const list = track.signals[resource];
    for (let k = list.length - 1; k >= 0; k--) {
      const signal = list[k];
      if (signal.time > time || signal.last < since) { if (signal.time < since - 60) break; continue; }
      sent.moveTo(x(signal.time), 2);
      sent.lineTo(x(signal.time), height - 2);
      for (let r = 0; r < rows; r++) {
        const i = r * every, y = 5 + (r + 0.5) * row, raw = signal.arrival[i];
        if (raw < -1e8) {
          if (signal.copy) continue;
          const at = x(signal.time) + 5, arm = size * 0.9;
          lost.moveTo(at - arm, y - arm); lost.lineTo(at + arm, y + arm);
          lost.moveTo(at - arm, y + arm); lost.lineTo(at + arm, y - arm);
          continue;
        }
        const arrival = signal.base + raw, end = Math.min(arrival, time), cut = signal.answer[i] >= 0;
        if (end < since) continue;
        const flight = cut && arrival <= time ? cutFlights : flights;
        flight.moveTo(Math.max(this.left, x(signal.time)), y);
        flight.lineTo(x(end), y);
        if (arrival <= time) (cut ? cuts : dots).rect(x(arrival) - size, y - size, 2 * size, 2 * size);
      }
    }
    context.lineWidth = Math.min(1, row * 0.35);
    context.globalAlpha = 0.45;
    context.strokeStyle = palette.hold;
    context.stroke(flights);
    context.strokeStyle = palette.cut;
    context.globalAlpha = 0.75;
    context.stroke(cutFlights);
    context.globalAlpha = 1;
    context.strokeStyle = palette.quiet;
    context.lineWidth = 1;
    context.stroke(sent);
    context.fillStyle = palette.hold;
    context.fill(dots);
    context.fillStyle = palette.cut;
    context.fill(cuts);
    context.strokeStyle = palette.lost;
    context.lineWidth = Math.max(0.8, size * 0.55);
    context.stroke(lost);
  }

  // Demand of one agent with its average, and what came of each of its copies.
  ofOne(track, time, resource, agent, span) {
    const { context, height } = this.sheet, { x } = this, since = Math.max(track.begin, time - span);
    const colour = shade(track.start.resources[resource].colour);
    const points = demandOf(track, resource, agent, since, time);
    const n = track.n, at = resource * n + agent;
    const frames = track.frames.filter((frame) => frame.time >= since - 1 && frame.time <= time);
    const best = track.best ? track.best[at] : NaN;
    let most = Number.isFinite(best) ? best : 0;
    for (const [, value] of points) most = Math.max(most, value);
    const bottom = height - 26, y = (value) => bottom - (value / (1.08 * most || 1)) * (bottom - 12);
    if (best >= 0) {
      line(context, [[this.left, y(best)], [this.right, y(best)]], palette.quiet, 1);
      write(context, "optimum", this.right, y(best) - 3, { align: "right" });
    }
    context.setLineDash([5, 3]);
    line(context, frames.map((frame) => [x(frame.time), y(frame.average[at])]), colour, 1.6);
    context.setLineDash([]);
    line(context, points.map(([when, value]) => [x(when), y(value)]), colour, 2);
    line(context, [[this.left, bottom], [this.right, bottom]], palette.line);
    for (const signal of track.signals[resource]) {
      if (signal.time > time || signal.last < since) continue;
      const raw = signal.arrival[agent], row = height - 13;
      if (raw < -1e8) {
        if (!signal.copy && signal.time >= since) write(context, "×", x(signal.time), row + 5, { colour: palette.lost, size: 15, weight: 700, align: "center" });
        continue;
      }
      const arrival = signal.base + raw;
      line(context, [[x(Math.max(since, signal.time)), row], [x(Math.min(time, arrival)), row]], palette.hold, 1);
      if (arrival > time || arrival < since) continue;
      context.beginPath();
      context.arc(x(arrival), row, 3.5, 0, 2 * Math.PI);
      context.fillStyle = signal.answer[agent] >= 0 ? palette.cut : palette.hold;
      context.fill();
    }
  }
}

// Corners of the demand of one agent.
function demandOf(track, resource, agent, since, until) {
  const at = resource * track.n + agent, points = [];
  let place = Math.max(0, lastUpTo(track.frames, since, (frame) => frame.time));
  for (; place < track.frames.length && track.frames[place].time <= until; place++) {
    const frame = track.frames[place], chunk = frame.chunk, next = track.frames[place + 1];
    const end = Math.min(until, next ? next.time : until);
    let demand = frame.demand[at], when = frame.time;
    points.push([when, demand]);
    if (!track.continuous) { points.push([end, demand]); continue; }
    const growth = chunk.increase[at];
    for (let k = 0; k < chunk.answered.length / 3; k++) {
      const time = chunk.from + chunk.answer[2 * k];
      if (time > end) break;
      if (time <= frame.time || chunk.answered[3 * k] !== resource || chunk.answered[3 * k + 1] !== agent || !(chunk.answer[2 * k + 1] > 0)) continue;
      demand += growth * (time - when);
      points.push([time, demand]);
      demand -= chunk.answer[2 * k + 1];
      when = time;
      points.push([time, demand]);
    }
    points.push([end, demand + growth * (end - when)]);
  }
  return points;
}
