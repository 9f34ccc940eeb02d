// The agents round the control unit, and the copies on their way.

// Where a lost copy is lost, as a share of the way: the same whenever it is drawn.
const lostAt = (agent, number) => 0.3 + 0.45 * (((agent * 2654435761 + number * 40503) >>> 0) % 1000) / 1000;

class Ring {
  constructor(sheet) {
    this.sheet = sheet;
    this.scale = [];
    this.places = [];
  }

  // The rings of some resources, each in a part of the sheet.
  draw(track, time, resources, options) {
    if (!this.sheet.begin()) return;
    const { width, height } = this.sheet, count = resources.length;
    this.places = [];
    const across = count === 1 ? 1 : width > 1.25 * height ? Math.min(count, 3) : Math.min(count, 2);
    const down = Math.ceil(count / across);
    resources.forEach((resource, k) => {
      const inRow = k < across * (down - 1) ? across : count - across * (down - 1);
      const w = width / across, h = height / down;
      const x = (width - inRow * w) / 2 + (k % across + 0.5) * w, y = (Math.floor(k / across) + 0.5) * h;
      this.one(track, time, resource, x, y, Math.min(w, h) / 2 - 6, { ...options, named: count > 1 });
    });
  }

  one(track, time, resource, x, y, radius, options) {
    const { context } = this.sheet, { n } = track;
    const few = n <= 150, inner = radius * (few ? 0.62 : 0.6), unit = radius * 0.12;
    const colour = shade(track.start.resources[resource].colour);
    const { demand, average } = track.agentsAt(time, resource);
    const best = track.best ? track.best.subarray(resource * n, (resource + 1) * n) : null;
    const place = { resource, x, y, inner, radius };
    this.places.push(place);
    context.save();
    context.translate(x, y);
    if (options.named) write(context, track.start.resources[resource].name, -radius, -radius + 14, { size: 13, colour: palette.ink, weight: 650 });
    context.strokeStyle = palette.grid;
    context.lineWidth = 1;
    context.beginPath();
    context.arc(0, 0, inner, 0, 2 * Math.PI);
    context.stroke();
    const longest = this.longest(resource, average, best, demand, few);
    this.outside(context, { n, inner, radius, few, colour, demand, average, best, longest });
    this.copies(context, track, time, resource, { ...place, unit, few, colour }, options);
    if (few) this.discs(context, { n, inner, colour, demand, longest });
    this.flashes(context, track, time, resource, { ...place, few }, options);
    if (options.agent >= 0) this.mark(context, n, inner, radius, options.agent);
    this.unit(context, track, time, resource, unit, colour);
    context.restore();
  }

  // What the longest bar stands for; it moves slowly, so that bars can be compared over time.
  longest(resource, average, best, demand, few) {
    let most = 1e-9;
    for (let i = 0; i < average.length; i++) {
      most = Math.max(most, 1.1 * average[i], best ? 1.1 * best[i] : 0, few ? 0.5 * demand[i] : 0.8 * demand[i]);
    }
    const before = this.scale[resource] || most;
    this.scale[resource] = most > before ? most : before + 0.02 * (most - before);
    return this.scale[resource];
  }

  // Averages as bars, and what they should be as ticks.
  outside(context, { n, inner, radius, few, colour, demand, average, best, longest }) {
    const room = radius - inner - (few ? 0.085 * radius : 0), from = inner + (few ? 0.085 * radius : 2);
    const thick = Math.max(0.8, Math.min(9, (2 * Math.PI * from) / n * 0.55));
    const length = (value) => Math.min(1, value / longest) * room;
    const bars = (values, wide, alpha) => {
      context.globalAlpha = alpha;
      context.strokeStyle = colour;
      context.lineWidth = wide;
      context.beginPath();
      for (let i = 0; i < n; i++) {
        const angle = (2 * Math.PI * i) / n - Math.PI / 2, c = Math.cos(angle), s = Math.sin(angle), end = from + length(values[i]);
        context.moveTo(from * c, from * s);
        context.lineTo(end * c, end * s);
      }
      context.stroke();
      context.globalAlpha = 1;
    };
    if (!few) bars(demand, thick, 0.35);
    bars(average, few ? thick : Math.max(0.6, 0.55 * thick), few ? palette.pale + 0.14 : 0.9);
    if (!best || !few) return;
    context.strokeStyle = palette.ink;
    context.lineWidth = 1.4;
    context.beginPath();
    for (let i = 0; i < n; i++) {
      if (best[i] < 0) continue;
      const angle = (2 * Math.PI * i) / n - Math.PI / 2, c = Math.cos(angle), s = Math.sin(angle), at = from + length(best[i]);
      context.moveTo(at * c - 0.7 * thick * s, at * s + 0.7 * thick * c);
      context.lineTo(at * c + 0.7 * thick * s, at * s - 0.7 * thick * c);
    }
    context.stroke();
  }

  discs(context, { n, inner, colour, demand, longest }) {
    const widest = Math.min(15, (Math.PI * inner) / n * 1.25 + 2);
    context.fillStyle = colour;
    for (let i = 0; i < n; i++) {
      const angle = (2 * Math.PI * i) / n - Math.PI / 2;
      const size = Math.max(1.2, Math.min(1.25, Math.sqrt(demand[i] / (1.6 * longest))) * widest);
      context.beginPath();
      context.arc(inner * Math.cos(angle), inner * Math.sin(angle), size, 0, 2 * Math.PI);
      context.fill();
    }
    context.strokeStyle = palette.raised;
    context.lineWidth = 0.75;
    context.stroke();
  }

  // A dot for each copy on its way, with a tail as long as it is fast.
  copies(context, track, time, resource, { inner, unit, few }, { speed, calm }) {
    const { n } = track, way = inner - unit - (few ? 9 : 4), list = track.signals[resource];
    const size = few ? Math.max(2, Math.min(3.2, 240 / n)) * Math.max(0.55, Math.min(1.15, inner / 170)) : 1.25;
    const fade = 0.9 * speed;
    const paths = { cut: new Path2D(), hold: new Path2D(), lost: new Path2D(), cross: new Path2D(), tails: new Path2D(), cutTails: new Path2D() };
    for (let k = list.length - 1; k >= 0; k--) {
      const signal = list[k];
      if (signal.time > time) continue;
      if (signal.last < time && signal.time + signal.mean + fade < time) {
        if (signal.time < time - 60) break;
        continue;
      }
      for (let i = 0; i < n; i++) this.copy(paths, signal, i, n, time, { unit, way, size, fade, few, calm, speed });
    }
    context.lineWidth = few ? 1.6 : 0.7;
    context.globalAlpha = few ? 0.35 : 0.2;
    context.strokeStyle = palette.hold;
    context.stroke(paths.tails);
    context.strokeStyle = palette.cut;
    context.stroke(paths.cutTails);
    context.globalAlpha = few ? 1 : 0.75;
    for (const name of ["hold", "lost", "cut"]) { context.fillStyle = palette[name]; context.fill(paths[name]); }
    context.globalAlpha = 1;
    context.strokeStyle = palette.lost;
    context.lineWidth = few ? 1.7 : 1;
    context.stroke(paths.cross);
  }

  copy(paths, signal, i, n, time, { unit, way, size, fade, few, calm, speed }) {
    const raw = signal.arrival[i], sent = signal.time, lost = raw < -1e8;
    if (lost && signal.copy) return;
    const arrival = signal.base + raw;
    const duration = lost ? signal.mean : arrival - sent;
    let share = duration > 0 ? (time - sent) / duration : 1;
    let gone = false;
    if (lost) {
      const stop = lostAt(i, signal.number);
      if (share >= stop || duration <= 0) { gone = true; if (time - sent - stop * duration > fade) return; share = stop; }
    } else if (share >= 1) return;
    const angle = (2 * Math.PI * i) / n - Math.PI / 2, c = Math.cos(angle), s = Math.sin(angle), at = unit + share * way;
    const x = at * c, y = at * s;
    if (gone) {
      const arm = few ? size * 1.1 : 1.6;
      paths.cross.moveTo(x - arm, y - arm); paths.cross.lineTo(x + arm, y + arm);
      paths.cross.moveTo(x - arm, y + arm); paths.cross.lineTo(x + arm, y - arm);
      return;
    }
    const cuts = !lost && signal.answer[i] >= 0;
    const path = lost ? paths.lost : cuts ? paths.cut : paths.hold;
    const big = cuts && few ? size * 1.25 : size;
    if (few) { path.moveTo(x + big, y); path.arc(x, y, big, 0, 2 * Math.PI); } else path.rect(x - big, y - big, 2 * big, 2 * big);
    if (!calm && duration > 0) {
      const tail = Math.max(unit, at - Math.min(0.18 * way, (0.14 * speed * way) / duration));
      const tails = cuts ? paths.cutTails : paths.tails;
      tails.moveTo(tail * c, tail * s);
      tails.lineTo(x, y);
    }
  }

  // A circle opens where an agent has just cut its demand.
  flashes(context, track, time, resource, { inner, few }, { speed, calm }) {
    const { n } = track, last = 0.5 * speed, list = track.signals[resource];
    context.strokeStyle = palette.cut;
    for (let k = list.length - 1; k >= 0; k--) {
      const signal = list[k];
      if (signal.time > time || signal.last < time - last) { if (signal.time < time - 60) break; continue; }
      for (let i = 0; i < n; i++) {
        const since = time - (signal.base + signal.arrival[i]);
        if (!(signal.answer[i] >= 0) || since < 0 || since > last) continue;
        const share = since / last, angle = (2 * Math.PI * i) / n - Math.PI / 2;
        context.globalAlpha = 1 - share;
        context.lineWidth = few ? 2.2 : 1;
        context.beginPath();
        context.arc(inner * Math.cos(angle), inner * Math.sin(angle), (few ? 0.045 * inner : 2) + (calm ? 2 : share * (few ? 0.07 * inner : 6)), 0, 2 * Math.PI);
        context.stroke();
      }
    }
    context.globalAlpha = 1;
  }

  mark(context, n, inner, radius, agent) {
    const angle = (2 * Math.PI * agent) / n - Math.PI / 2, c = Math.cos(angle), s = Math.sin(angle);
    line(context, [[(radius + 1) * c, (radius + 1) * s], [(radius + 6) * c, (radius + 6) * s]], palette.ink, 3);
    context.beginPath();
    context.arc(inner * c, inner * s, n <= 150 ? 13 : 6, 0, 2 * Math.PI);
    context.strokeStyle = palette.ink;
    context.lineWidth = 1.5;
    context.stroke();
  }

  // The control unit: filled as far as the capacity is, and an arc for the rest of its hold-off.
  unit(context, track, time, resource, radius, colour) {
    const level = track.levelAt(time), total = track.total(resource, time, time, () => {});
    const share = total / level.capacity[resource];
    context.beginPath();
    context.arc(0, 0, radius, 0, 2 * Math.PI);
    context.fillStyle = palette.raised;
    context.fill();
    context.save();
    context.clip();
    context.fillStyle = share > 1 ? palette.lost : colour;
    context.globalAlpha = 0.28;
    const fill = Math.min(1.02, share) * 2 * radius;
    context.fillRect(-radius, radius - fill, 2 * radius, fill);
    context.restore();
    context.strokeStyle = colour;
    context.lineWidth = 2;
    context.stroke();
    write(context, Number.isFinite(share) ? `${Math.round(100 * share)} %` : "", 0, Math.max(10, radius * 0.34) * 0.36, {
      size: Math.max(10, radius * 0.42), colour: share > 1 ? palette.lost : palette.ink, align: "center", weight: 650,
    });
    const list = track.signals[resource];
    const last = list[lastUpTo(list, time, (signal) => signal.time)];
    const holdOff = track.holdOffAt(time);
    if (!last || !(holdOff > 0)) return;
    const rest = 1 - (time - last.time) / holdOff;
    if (rest <= 0) return;
    context.beginPath();
    context.arc(0, 0, radius + 5, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * rest);
    context.strokeStyle = palette.ink;
    context.lineWidth = 2.5;
    context.stroke();
  }

  // The agent that is drawn at a point of the sheet; -1 where there is none.
  agentAt(px, py, n) {
    for (const { x, y, inner, radius } of this.places) {
      const distance = Math.hypot(px - x, py - y);
      if (distance > inner * 0.75 && distance < radius + 8) {
        const turn = (Math.atan2(py - y, px - x) + Math.PI / 2) / (2 * Math.PI);
        return Math.round((turn - Math.floor(turn)) * n) % n;
      }
    }
    return -1;
  }
}
