// Total demand against capacity, misallocation over time, and averages against the optimum.

const WORDS = {
  leave: "agent leaves", join: "agent joins", capacity: "capacity", costs: "costs", cut: "cut off", heal: "heard again", fail: "unit down",
  recover: "unit back", normalization: "Gamma", threshold: "threshold", increase: "alpha", decrease: "beta", hold_off: "hold-off", channel: "channel",
};

class Saw {
  constructor(sheet) { this.sheet = sheet; this.top = 0; }

  draw(track, time, resource, span) {
    if (!this.sheet.begin()) return;
    const { context, width, height } = this.sheet, since = time - span;
    const left = 34, right = width - 4, bottom = height - 14, high = 8;
    const x = (when) => left + ((when - since) / span) * (right - left);
    const levels = track.levels, now = track.levelAt(time);
    const corners = this.corners(track, resource, since, time, (when) => Math.round(x(when)));
    let most = 0, least = Infinity;
    for (const [, low, top] of corners) { most = Math.max(most, top); least = Math.min(least, low); }
    const capacity = now.capacity[resource];
    const limit = Math.min(capacity, now.limit[resource]), room = Math.max(0.02 * capacity, 0.12 * (most - least));
    const top = Math.max(capacity, most) + room, low = Math.max(0, Math.min(0.96 * limit, least - room));
    // Axes move slowly, but never cut anything off.
    this.top = Math.max(top, this.top ? this.top + 0.04 * (top - this.top) : top);
    this.low = Math.min(low, this.low === undefined ? low : this.low + 0.04 * (low - this.low));
    const y = (value) => bottom - ((value - this.low) / (this.top - this.low)) * (bottom - high);
    const colour = shade(track.start.resources[resource].colour);
    for (const step of steps(this.low, this.top, 3)) {
      line(context, [[left, y(step)], [right, y(step)]], palette.grid);
      write(context, number(step), left - 5, y(step) + 3.5, { align: "right", size: 10 });
    }
    this.times(context, since, time, x, bottom, height);
    this.levels(context, levels, resource, since, time, x, y);
    this.over(context, corners, y(capacity), y, left, right, high);
    context.beginPath();
    for (const [column, low2, top2, first, last] of corners) {
      context.lineTo(column, y(first));
      if (top2 !== first) context.lineTo(column, y(top2));
      if (low2 !== top2) context.lineTo(column, y(low2));
      context.lineTo(column, y(last));
    }
    context.strokeStyle = colour;
    context.lineWidth = 1.8;
    context.stroke();
    this.marks(context, track, resource, since, time, x, bottom, high, colour);
  }

  // Total demand, at most once for each column of the picture: least, greatest, first and last value there.
  corners(track, resource, since, until, columnOf) {
    const found = [];
    track.total(resource, since, until, (when, value) => {
      const column = columnOf(when), last = found[found.length - 1];
      if (last && last[0] === column) {
        last[1] = Math.min(last[1], value);
        last[2] = Math.max(last[2], value);
        last[4] = value;
      } else found.push([column, value, value, value, value]);
    });
    return found;
  }

  times(context, since, time, x, bottom, height) {
    for (const step of steps(Math.max(0, since), time, 5)) {
      line(context, [[x(step), bottom], [x(step), bottom + 3]], palette.line);
      write(context, number(step, 5), x(step), height - 2, { align: "center", size: 10 });
    }
  }

  levels(context, levels, resource, since, time, x, y) {
    const draw = (name, dash, width) => {
      context.setLineDash(dash);
      context.beginPath();
      levels.forEach((level, k) => {
        const from = Math.max(since, level.time), to = Math.min(time, k + 1 < levels.length ? levels[k + 1].time : time);
        if (to < from) return;
        context.lineTo(x(from), y(level[name][resource]));
        context.lineTo(x(to), y(level[name][resource]));
      });
      context.strokeStyle = palette.ink;
      context.lineWidth = width;
      context.stroke();
      context.setLineDash([]);
    };
    draw("capacity", [], 1.2);
    if (levels.some((level) => level.limit[resource] < 0.9999 * level.capacity[resource])) draw("limit", [4, 3], 1);
  }

  over(context, corners, line0, y, left, right, high) {
    context.save();
    context.beginPath();
    context.rect(left, high - 8, right - left, Math.max(0, line0 - high + 8));
    context.clip();
    context.beginPath();
    corners.forEach(([column, , top]) => context.lineTo(column, y(top)));
    if (corners.length) {
      context.lineTo(corners[corners.length - 1][0], line0);
      context.lineTo(corners[0][0], line0);
    }
    context.fillStyle = palette.over;
    context.fill();
    context.restore();
  }

  marks(context, track, resource, since, time, x, bottom, high, colour) {
    context.fillStyle = colour;
    const list = track.signals[resource];
    for (let k = list.length - 1; k >= 0 && list[k].time >= since; k--) {
      if (list[k].time <= time && !list[k].copy) context.fillRect(x(list[k].time) - 0.9, bottom - 7, 1.8, 7);
    }
    let before = -Infinity;
    for (const note of track.notes) {
      if (note.time < since || note.time > time || (note.resource >= 0 && note.resource !== resource)) continue;
      const at = x(note.time);
      if (at - before < 2) continue;
      context.setLineDash([2, 3]);
      line(context, [[at, high - 6], [at, bottom]], palette.quiet);
      context.setLineDash([]);
      const late = at > x(time) - 60;
      if (at - before > 60) write(context, WORDS[note.kind] || note.kind, late ? at - 3 : at + 3, high + 3, { size: 10, align: late ? "right" : "left" });
      before = at;
    }
  }
}

// Misallocation on logarithmic axes, and where theory expects it.
class ErrorChart {
  constructor(sheet) { this.sheet = sheet; }

  draw(track, time) {
    if (!this.sheet.begin()) return;
    const { context, width, height } = this.sheet, left = 40, right = width - 16, bottom = height - 26, high = 8;
    const measures = track.measures.filter((measure) => measure.time <= time + 1e-9);
    let low = 0.03, top = 1;
    for (const { misallocation } of measures) for (const value of misallocation) { low = Math.min(low, value); top = Math.max(top, value); }
    if (track.band) for (const values of track.band.low) low = Math.min(low, values[Math.max(0, lastUpTo(track.band.time, time, (t) => t))]);
    low = Math.max(1e-4, low * 0.8);
    const last = Math.max(100, time * 1.15), lx = (value) => left + (Math.log(value) / Math.log(last)) * (right - left);
    const ly = (value) => bottom - ((Math.log(value) - Math.log(low)) / (Math.log(top) - Math.log(low))) * (bottom - high);
    for (let power = -4; power <= 1; power++) {
      for (const factor of [1, 2, 5]) {
        const value = factor * 10 ** power;
        if (value < low || value > top * 1.001) continue;
        line(context, [[left, ly(value)], [right, ly(value)]], palette.grid);
        if (factor === 1 || top / low < 60) write(context, `${number(100 * value)} %`, left - 5, ly(value) + 3.5, { align: "right", size: 10 });
      }
    }
    for (let value = 1; value <= last; value *= 10) {
      line(context, [[lx(value), high], [lx(value), bottom]], palette.grid);
      write(context, number(value, 5), lx(value), bottom + 12, { align: "center", size: 10 });
    }
    write(context, "time", right, bottom + 23, { align: "right", size: 10 });
    context.save();
    context.beginPath();
    context.rect(left, high - 4, right - left, bottom - high + 4);
    context.clip();
    track.start.resources.forEach((resource, j) => {
      const colour = shade(resource.colour);
      if (track.band) this.band(context, track.band, j, lx, ly, colour);
      line(context, measures.map((measure) => [lx(measure.time), ly(Math.max(low, measure.misallocation[j]))]), colour, 2);
      const end = measures[measures.length - 1];
      if (!end) return;
      context.beginPath();
      context.arc(lx(end.time), ly(Math.max(low, end.misallocation[j])), 3, 0, 2 * Math.PI);
      context.fillStyle = colour;
      context.fill();
    });
    context.restore();
  }

  band(context, band, j, lx, ly, colour) {
    context.beginPath();
    band.time.forEach((when, k) => context.lineTo(lx(when), ly(band.low[j][k])));
    for (let k = band.time.length - 1; k >= 0; k--) context.lineTo(lx(band.time[k]), ly(band.high[j][k]));
    context.fillStyle = colour;
    context.globalAlpha = palette.pale * 0.7;
    context.fill();
    context.globalAlpha = 1;
  }
}

// What each agent holds in the mean, over what it would hold at the optimum for what is used.
class Scatter {
  constructor(sheet) { this.sheet = sheet; }

  draw(track, time, agent) {
    if (!this.sheet.begin()) return;
    const { context, width, height } = this.sheet, { n, m } = track;
    const side = Math.min(width - 26, height - 30), left = 22, bottom = height - 24, high = bottom - side;
    context.strokeStyle = palette.line;
    context.lineWidth = 1;
    context.strokeRect(left, high, side, side);
    write(context, "optimum →", left + side, bottom + 13, { align: "right", size: 10 });
    context.save();
    context.translate(left - 6, high);
    context.rotate(-Math.PI / 2);
    write(context, "average →", 0, 0, { align: "right", size: 10 });
    context.restore();
    line(context, [[left, bottom], [left + side, high]], palette.quiet);
    if (!track.best) return;
    const size = n > 150 ? 1 : 2.2;
    for (let j = 0; j < m; j++) {
      const { average } = track.agentsAt(time, j), best = track.best.subarray(j * n, (j + 1) * n);
      let most = 1e-12;
      for (let i = 0; i < n; i++) most = Math.max(most, best[i]);
      context.fillStyle = shade(track.start.resources[j].colour);
      context.globalAlpha = 0.7;
      const at = (value) => Math.min(1, value / (1.25 * most)) * side;
      for (let i = 0; i < n; i++) {
        if (best[i] < 0) continue;
        context.beginPath();
        context.arc(left + at(best[i]), bottom - at(average[i]), size, 0, 2 * Math.PI);
        context.fill();
      }
      context.globalAlpha = 1;
      if (agent >= 0 && best[agent] >= 0) {
        context.beginPath();
        context.arc(left + at(best[agent]), bottom - at(average[agent]), 5.5, 0, 2 * Math.PI);
        context.strokeStyle = palette.ink;
        context.lineWidth = 1.5;
        context.stroke();
      }
    }
  }
}
