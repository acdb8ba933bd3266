// The page's own solver at work: joints are dragged, dimensions changed, curves drawn anew.
L.asked = turned(L.asked); L.rates = L.rates.map(turned);
const S = solver(F, L), T = D.poses, dim = D.dim, places = L.points.length, first = L.q.length - D.scalars.length;
const markers = new Float64Array(dim * L.markers.length), which = way => L.markers.map((x, i) => x[1] === way ? i : -1).filter(i => i >= 0), riding = which(false), guiding = which(true);
const now = { q: Float64Array.from(L.q), c: Float64Array.from(L.c), k: Float64Array.from(L.k), d: Float64Array.from(L.d) };
const copy = s => ({ q: s.q.slice(), c: s.c.slice(), k: s.k.slice(), d: s.d.slice() });
const original = copy(now), drawn = [D.points, D.directions, D.scalars, D.status, D.arrows, D.tips, D.turns, D.box, D.items, D.series], recorded = structuredClone(drawn), past = [];
const poses = new Array(T), motions = new Array(T);
const turn = 2 * PI, middles = L.names.map((name, i) => { const x = L.asked.map(row => row[i]).filter(v => v !== null); return (min(...x) + max(...x)) / 2; });
const undo = $("undo") || el("button");
let designed = false, wholly = false, job = null, shaping = false, shift = [0, 0];
const say = text => { $("banner").hidden = !text; if (text) $("banner").textContent = text; };
const markersAt = q => { F.markers(q, now.k, markers); return markers; };
// Where a column (a point, or a marker that rides on a body) is in a pose.
const placeOf = column => q => column < places ? axes.map((_, j) => q[dim * column + j]) : axes.map((_, j) => markersAt(q)[dim * riding[column - places] + j]);
// Rates of a marker, by differences: in the plane it is linear in the coordinates, and they are exact.
function riding_rates(column, q, [v, a]) {
  const h = 1e-4 * L.length / max(1e-300, ...v.map(abs)), place = placeOf(column);
  const at = sign => place(q.map((x, i) => x + sign * h * v[i] + (a ? 0.5 * h * h * a[i] : 0))), [ahead, here, behind] = [at(1), place(q), at(-1)];
  return [ahead.map((x, i) => (x - behind[i]) / (2 * h)), a && ahead.map((x, i) => (x - 2 * here[i] + behind[i]) / (h * h))];
}
// The rates of all coordinates in a pose, once they are asked for, and that of a column.
const ratesOf = (pose, q) => motions[pose] ??= S.rates(q, now.c, L.rates.map(x => x[pose === T ? nearest : pose]));
function rateOf(pose, column, order, q = pose === T ? now.q : poses[pose]) {
  const all = q && L.rates.length && ratesOf(pose, q);
  return !all || !all[order] ? null : column < places ? axes.map((_, j) => all[order][dim * column + j]) : riding_rates(column, q, all)[order];
}
// Whole turns that an angle has made beyond the motion's values.
const beyond = i => L.angles[i] ? turn * round(0.999999 * (now.q[L.driven[i]] - middles[i]) / turn) : 0;
const askedOf = pose => L.asked[pose].map((x, i) => x + beyond(i));
// A vector as an arrow: to scale, but no longer than the longest.
const cut = (v, s) => v && v.map(x => x * min(s, D.longest / hypot(...v)));
let exert = () => {};
{{EXERTING}}
// Write a pose into the page's arrays; T is the one that is being changed.
function store(pose, q) {
  const at = markersAt(q), put = (to, from, i) => axes.forEach((axis, j) => { to[axis][pose] = from[dim * i + j]; });
  D.points.forEach((p, i) => i < places ? put(p, q, i) : put(p, at, riding[i - places]));
  const vectors = (first - dim * places) / dim;
  (D.directions || []).forEach((v, i) => { if (i < vectors) put(v, q, places + i); else put(v, at, guiding[i - vectors]); });
  D.scalars.forEach((s, i) => { s.values[pose] = q[first + i]; });
  for (const scalar in D.turns || {}) D.turns[scalar][pose] = q[first + Number(scalar)];
  motions[pose] = null;
  if (dim === 2) D.arrows.forEach(a => a.columns.forEach((c, i) => { a.vectors[i][pose] = cut(rateOf(pose, c, a.noun === "velocity" ? 0 : 1, q), a.scale) || [null, null]; }));
  else D.tipped.forEach(([c, o, s], i) => { const t = D.tips[i], p = D.points[c], w = cut(rateOf(pose, c, o, q), s); axes.forEach((axis, j) => { t[axis][pose] = p[axis][pose] + (w ? w[j] : 0); }); });
  exert(pose, q);
}
function fail(pose) {
  D.status[pose] = "live";
  for (const p of D.points) if (p.moves) for (const axis of axes) p[axis][pose] = null;
  for (const s of [...D.scalars, ...D.series]) s.values[pose] = null;
}
D.sentences.live = "With these dimensions the mechanism does not reach it.";
// All poses of the motion again, from the present one: first a few, then those between.
function* retrace() {
  const stride = max(1, ceil(T / 60)), begin = min(nearest, T - 1), start = now.q.slice(), asked = L.asked.map((_, pose) => askedOf(pose));
  poses.fill(null);
  D.status.fill("waiting", 0, T);
  const reach = (q, pose) => { const good = S.follow(q, now.c, asked[pose]); if (good) { poses[pose] = q.slice(); D.status[pose] = 0; store(pose, q); } else fail(pose); return good; };
  const there = reach(start, begin);
  for (const by of [stride, -stride]) {
    const q = start.slice();
    let good = there;
    for (let pose = begin, next; good; pose = next) {
      next = max(0, min(T - 1, pose + by));
      if (next === pose) break;
      good = reach(q, next);
      yield;
    }
  }
  yield "coarse";
  for (const by of [1, -1]) {
    let q = start.slice(), good = there;
    for (let pose = begin + by; pose >= 0 && pose < T; pose += by) {
      if (poses[pose]) { q = poses[pose].slice(); good = true; continue; }
      if (good) good = reach(q, pose); else fail(pose);
      yield;
    }
  }
}
function work(end) {
  while (job) {
    const step = job.next();
    if (step.done) { job = null; stretch(); drawTraces(); strip(); graph(); break; }
    if (step.value) { drawTraces(); graph(); }
    if (performance.now() > end) { raf(() => work(performance.now() + 5)); break; }
  }
  owner.dataset.busy = job ? 1 : 0;
}
// Guides and slots as long as what slides along them needs.
function stretch() {
  const pose = k;
  let changed = false;
  for (const item of D.items) {
    if (dim !== 2 || !item.reach || !item.reach.length) continue;
    let low = Infinity, high = -Infinity;
    for (const [p, spare] of item.reach) for (k = 0; k < T; k++) if (D.status[k] === 0) {
      const [o, e] = stand(item.frame), x = at(p), s = ((x[0] - o[0]) * e[0] + (x[1] - o[1]) * e[1]) / scale;
      low = min(low, s - spare); high = max(high, s + spare);
    }
    if (!(high >= low)) continue;
    changed = true;
    if (item.vertices) { item.vertices[0][0] = low; item.vertices[1][0] = high; } else { item.start[0] = low; item.end[0] = high; }
  }
  k = pose;
  if (changed) layout();
}
function redraw() {
  designed = true;
  for (const s of D.series) if (!s.made) s.values.fill(null);
  const idle = !job;
  job = retrace();
  if (idle) work(performance.now() + 5);
  sizes();
}
function present() {
  let least = Infinity;
  L.asked.forEach((_, pose) => { const far = hypot(...askedOf(pose).map((x, i) => x - now.q[L.driven[i]])); if (far < least) { least = far; nearest = pose; } });
  store(T, now.q);
  L.names.forEach((name, i) => { const s = scalarOf(name); if (s) s.values[T] -= beyond(i); });
  D.status[T] = 0; show(T); inputs();
}
function remember() { past.push(copy(now)); if (past.length > 60) past.shift(); undo.disabled = false; }
function back(state) {
  Object.assign(now, copy(state));
  if (past.length) redraw();
  else {
    job = null; designed = wholly = false;
    restore(drawn, structuredClone(recorded));
    poses.fill(null); motions.fill(null);
    k = nearest; layout(); strip();
  }
  say(""); sizes(); graph();
  if (designed) present(); else show(nearest);
  undo.disabled = !past.length;
}
function restore(kept, old) {
  for (const key in old) if (old[key] && typeof old[key] === "object") restore(kept[key], old[key]); else kept[key] = old[key];
  if (Array.isArray(kept)) kept.length = old.length;
}
const deadPoint = () => "Dead point: " + L.names.map((name, i) => `${symbolOf(name)} stops at ${shownInput(i)}`).join(", ") + ".";
// Lead the inputs somewhere; where that is not reached, stay at the last pose and say so.
function lead(i, value) {
  take();
  const target = L.driven.map((c, j) => j === i ? value + beyond(i) : now.q[c]);
  const good = S.follow(now.q, now.c, target);
  present();
  say(good ? "" : deadPoint());
  return good;
}
// -- what is handled ----------------------------------------------------------------------------------------------
const scalarOf = name => D.scalars.find(s => s.name === name);
const symbolOf = name => (scalarOf(name) || { symbol: name }).symbol;
const shownInput = i => { const s = scalarOf(L.names[i]); return s ? textOf(s, now.q[L.driven[i]]) : number(now.q[L.driven[i]]) + (D.unit ? " " + D.unit : ""); };
const idle = node => root.activeElement !== node;
const control = (parent, name, unit) => {
  const row = el("div"), label = el("label"), slide = el("input"), field = el("input");
  row.className = "control"; label.textContent = name + (unit ? ` [${unit}]` : "");
  slide.type = "range"; field.type = "number"; slide.step = field.step = "any";
  give(slide, { "aria-label": name + ", slider" }); give(field, { "aria-label": name });
  row.append(label, field, slide); parent.append(row);
  return { row, label, slide, field, touched: false };
};
const driving = L.names.map((name, i) => {
  const values = L.asked.map(x => x[i]), low = min(...values), high = max(...values), spare = high > low ? 0 : L.angles[i] ? PI : 0.5 * L.length;
  const c = control($("driving"), symbolOf(name), L.angles[i] ? "" : D.unit);
  const factor = () => L.angles[i] && degrees ? 180 / PI : 1;
  const go = value => { pause(); if (isFinite(value)) lead(i, value); };
  on(c.slide, "input", () => go(Number(c.slide.value)));
  on(c.field, "change", () => go(Number(c.field.value) / factor()));
  c.slide.min = low - spare; c.slide.max = high + spare;
  return { ...c, factor, i };
});
function inputs() {
  for (const c of driving) {
    const x = k < T ? L.asked[k][c.i] : now.q[L.driven[c.i]] - beyond(c.i);
    if (idle(c.slide)) c.slide.value = x;
    if (idle(c.field)) c.field.value = Number((x * c.factor()).toPrecision(6));
    c.label.textContent = symbolOf(L.names[c.i]) + (L.angles[c.i] ? degrees ? " [°]" : " [rad]" : D.unit ? ` [${D.unit}]` : "");
  }
}
{{SHAPING}}
// The solver's pose becomes the one that is shown.
function take() {
  if (k === T || D.status[k] !== 0) return;
  if (poses[k]) now.q.set(poses[k]); else S.follow(now.q, now.c, askedOf(k));
}
const shown = inputs;
const rated = order => D.points.flatMap((p, column) => p.moves && L.rates.length >= order ? [{
  text: `${["speed", "acceleration"][order - 1]} of ${p.name}`, unit: `${D.unit}/s${order > 1 ? "²" : ""}`, of: column,
  at: i => { whole(); const v = D.status[i] ? null : rateOf(i, column, order - 1); return v ? hypot(...v) : null; },
}] : []);
// Rates are known of poses that were solved here: of all of them, once they are asked for.
function whole() {
  if (wholly || designed) return;
  wholly = true;
  const kept = D.status.slice(), q = now.q.slice(), good = L.asked.map((_, pose) => !kept[pose]);
  for (const by of [1, -1]) { const p = q.slice(); for (let pose = L.start; pose >= 0 && pose < T && good[pose] && S.follow(p, now.c, L.asked[pose]); pose += by) poses[pose] = p.slice(); }
}
sizes();
$("driven").hidden = false;
$("dimensions").hidden = !sized.length;
// For scripts on the page: all coordinates where the inputs are led to, or null; and as they are now.
const solve = target => { take(); const good = S.follow(now.q, now.c, target); present(); return good ? [...now.q] : null; }, design = () => ({ q: [...now.q], dimensions: [...now.d] }), plotted = () => Object.fromEntries(D.series.map(s => [s.symbol, s.values[k] ?? null]));
return { altered: () => designed, exerts: !!F.forces, shown, grips, rates: () => [...rated(1), ...rated(2)], now, solve, design, plotted, take, back, present, remember, fit, askedOf, markersAt };
