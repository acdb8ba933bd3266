// The page's own solver at work: joints are dragged, dimensions changed, curves drawn anew.
const turned = rows => { const all = rows.map(row => unpacked(row)); return all[0].map((_, pose) => all.map(row => row[pose])); };
L.asked = turned(L.asked); L.rates = L.rates.map(turned);
// Inputs to the last digit, where the tables have few.
L.names.forEach((name, i) => { const s = D.scalars.find(s => s.name === name); L.asked.forEach((row, pose) => { if (s?.values[pose] != null) s.values[pose] = row[i]; }); });
const S = solver(F, L), T = D.poses, dim = D.dim, places = L.points.length, first = L.q.length - D.scalars.length, markers = zeros(dim * L.markers.length);
const copy = s => Object.fromEntries(["q", "c", "k", "d"].map(name => [name, Float64Array.from(s[name])]));
const now = copy(L), original = copy(L), drawn = [columns, D.scalars, D.status, D.box, D.items, D.series], recorded = structuredClone(drawn), past = [];
const poses = new Array(T), motions = new Array(T), betweens = new Array(T);
const ranges = L.names.map((_, i) => extent(L.asked.filter(row => row[i] !== null), i));
const undo = $("undo");
let designed = false, wholly = false, job = null, shaping = false;
const markersAt = q => { F.markers(q, now.k, markers); return markers; };
// Where columns stand: whether among the markers, and from which number on.
const own = (count, from) => Array.from({ length: count }, (_, i) => [0, dim * (from + i)]), marked = directed => L.markers.flatMap((x, i) => x[1] === directed ? [[1, dim * i]] : []);
const sources = [...own(places, 0), ...marked(false), ...own(first / dim - places, places), ...marked(true)];
const placeIn = (q, column) => { const [marker, i] = sources[column]; return Array.from((marker ? markersAt(q) : q).subarray(i, i + dim)); };
// The rates of all coordinates in a pose, once they are asked for.
const ratesOf = (pose, q) => motions[pose] ??= S.rates(q, now.c, L.rates.map(x => x[pose === T ? nearest : pose]));
// That of a column; of a marker by differences: in the plane it is linear in the coordinates, and they are exact.
function rateOf(pose, column, order, q = pose === T ? now.q : poses[pose]) {
  const [v, a] = q && L.rates.length && ratesOf(pose, q) || [], [marker, i] = sources[column];
  if (!v || order && !a) return null;
  if (!marker) return Array.from((order ? a : v).subarray(i, i + dim));
  const h = 1e-4 * L.length / (largest(v) || 1);
  const [ahead, here, behind] = [1, 0, -1].map(sign => placeIn(q.map((x, j) => x + sign * h * v[j] + (sign && a ? 0.5 * h * h * a[j] : 0)), column));
  return ahead.map((x, j) => order ? (x - 2 * here[j] + behind[j]) / (h * h) : (x - behind[j]) / (2 * h));
}
// Whole turns that an angle has made beyond the motion's values, where nothing counts them.
const beyond = i => { const [low, high] = ranges[i], x = now.q[L.driven[i]]; return L.periodic[i] && max(low - x, x - high) > 1e-9 ? turn * round(0.999999 * (x - (low + high) / 2) / turn) : 0; };
const wrapped = (x, i) => L.angles[i] ? x - turn * round(x / turn) : x;
const askedOf = pose => L.asked[pose].map((x, i) => x + beyond(i));
// The tip of an arrow: to scale, but no longer than the longest.
const point = (pose, [foot, tip], v, scale) => put(tip, pose, axes.map((axis, j) => columns[foot][axis][pose] + (v ? v[j] * min(scale, D.longest / hypot(...v)) : 0)));
let exert = () => {}, rest = exert, loose = () => !F.forces;
{{EXERTING}}
// Write a pose into the page's arrays; T is the one that is being changed.
function note(pose, q) {
  const at = markersAt(q);
  sources.forEach(([marker, i], column) => put(column, pose, (marker ? at : q).subarray(i)));
  D.scalars.forEach((s, i) => { s.values[pose] = q[first + i]; });
  L.names.forEach((name, i) => { const s = scalarOf(name); if (s) s.values[pose] = pose < T ? L.asked[pose][i] : q[L.driven[i]] - beyond(i); });
}
function store(pose, q) {
  note(pose, q); motions[pose] = null;
  for (const set of D.arrows) if (set.order < 2) for (const shaft of set.shafts) point(pose, shaft, rateOf(pose, shaft[0], set.order, q), set.scale);
  exert(pose, q);
}
function fail(pose) {
  D.status[pose] = "live";
  D.points.forEach((p, column) => {
    const [marker, i] = sources[column];
    if (p.moves) for (const axis of axes) p[axis][pose] = null;
    else if (!marker) put(column, pose, now.q.subarray(i));  // the ground is that of the present design
  });
  for (const s of [...D.scalars, ...D.series]) s.values[pose] = null;
  L.names.forEach((name, i) => { const s = scalarOf(name); if (s && pose < T) s.values[pose] = L.asked[pose][i]; });
}
// All poses of the motion again, from the present one: first a few, then those between.
function* retrace() {
  const stride = max(1, ceil(T / 60)), begin = min(nearest, T - 1), start = now.q.slice(), asked = L.asked.map((_, pose) => askedOf(pose));
  poses.fill(null); betweens.fill();
  D.status.fill("waiting", 0, T);
  const reach = (q, pose) => { const good = S.follow(q, now.c, asked[pose]); if (good) { poses[pose] = q.slice(); D.status[pose] = 0; store(pose, q); } else fail(pose); return good; };
  const there = reach(start, begin);
  for (const by of [stride, -stride]) {
    const q = start.slice();
    for (let pose = begin, good = there; good;) {
      const next = max(0, min(T - 1, pose + by));
      if (next === pose) break;
      good = reach(q, pose = next);
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
  // Where paths would show chords, between the poses too: a step is halved as long as one of its middles lies off.
  const [low, high] = D.box, close = 1e-3 * hypot(...low.map((x, i) => high[i] - x)), off = (a, b, c) => hypot(...b.map((x, i) => x - (a[i] + c[i]) / 2));
  const bent = i => poses[i - 1] && poses[i] && poses[i + 1] && D.points.some(p => off(...[-1, 0, 1].map(by => axes.map(axis => p[axis][i + by]))) > 2 * close);
  // Inputs at a share of a step: smooth, and monotone where they are; slopes are harmonic means of the steps.
  const step = (i, j) => asked[i + 1][j] - asked[i][j], slope = (i, j) => { const d = step(max(i - 1, 0), j), e = step(min(i, T - 2), j); return d * e > 0 ? 2 * d * e / (d + e) : 0; };
  const eased = (i, s) => asked[i].map((a, j) => { const d = step(i, j); return a + s * d + s * (1 - s) * ((1 - s) * (slope(i, j) - d) - s * (slope(i + 1, j) - d)); });
  const halved = (i, p, r, from, size) => {
    const q = p.slice(), half = size / 2;
    return size > 0.04 && S.follow(q, now.c, eased(i, from + half)) && D.points.some((_, column) => off(...[p, q, r].map(at => placeIn(at, column))) > close)
      ? [...halved(i, p, q, from, half), q, ...halved(i, q, r, from + half, half)] : [];
  };
  for (let i = 0; i < T - 1; i++) if (poses[i] && poses[i + 1] && (bent(i) || bent(i + 1))) { betweens[i] = halved(i, poses[i], poses[i + 1], 0, 1); yield; }
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
function redraw() {
  designed = true; easy = null;
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
  D.status[T] = 0; show(T);
}
function remember() { past.push(copy(now)); if (past.length > 60) past.shift(); undo.disabled = false; }
function back(state) {
  easy = null;
  Object.assign(now, copy(state));
  if (past.length) redraw();
  else {
    job = null; designed = wholly = false;
    restore(drawn, structuredClone(recorded));
    poses.fill(null); motions.fill(null);
    k = nearest; layout(); strip();
  }
  sizes(); graph();
  if (designed) present(); else show(nearest);
  say(""); undo.disabled = !past.length;
}
function restore(kept, old) {
  for (const key in old) if (old[key] && typeof old[key] === "object") restore(kept[key], old[key]); else kept[key] = old[key];
  if (Array.isArray(kept)) kept.length = old.length;
}
const everywhere = () => D.points.flatMap(p => p.x.flatMap((x, pose) => D.status[pose] || x == null ? [] : [axes.map(axis => p[axis][pose])]));
// Lead the inputs to a target; where that is not reached, stay at the last pose and say so.
// From a dead point itself no way begins: then from the last pose that was at ease.
let easy = null;
const ease = S.swift(now.q, now.c), led = target => {
  let good = S.follow(now.q, now.c, target);
  const q = !good && easy?.slice();
  if (q && (good = S.follow(q, now.c, target))) now.q.set(q);
  if (good && S.swift(now.q, now.c) < 100 * ease) easy = now.q.slice();
  return good;
};
function tell(good) {
  present();
  const is = L.names.length > 1 ? "=" : "stops at";  // of several inputs it need not be all that stop
  say(good ? "" : "Dead point: " + L.names.map((name, i) => `${symbolOf(name)} ${is} ${textOf(scalarOf(name) || { unit: D.unit }, now.q[L.driven[i]])}`).join(", ") + ".");
}
// -- what is handled ----------------------------------------------------------------------------------------------
const scalarOf = name => D.scalars.find(s => s.name === name), symbolOf = name => scalarOf(name)?.symbol || name;
const idle = node => root.activeElement !== node;
const control = (parent, name, unit) => {
  const label = el("label", {}, name + within(unit)), field = el("input", { type: "number", step: "any" }), slide = el("input", { type: "range", step: "any" });
  give(field, { "aria-label": name }); give(slide, { "aria-label": name + ", slider" });
  $(parent).append(el("div", { className: "control" }, label, field, slide));
  const heard = (go, done) => { on(slide, "input", () => go(+slide.value)); on(field, "change", () => { if (field.value) go(+field.value, true); else { said = ""; field.blur(); show(k); } done(); }); on(slide, "change pointerup blur", done); on(field, "blur", () => { shown(); sizes(); }); };
  return { label, slide, field, heard, fill: (x, shown = x) => { if (idle(slide)) slide.value = x; if (idle(field)) field.value = +shown.toPrecision(6); } };
};
const driving = L.names.map((name, i) => {
  const [low, high] = ranges[i], spare = high > low ? 0 : L.angles[i] ? PI : 0.5 * L.length;
  const c = control("driving", symbolOf(name)), factor = () => L.angles[i] && degrees ? 180 / PI : 1;
  c.heard((x, typed) => { if (typed) x = x / factor() % (L.periodic[i] ? 99 * turn : 1e99); pause(); take(); tell(led(L.driven.map((at, j) => j === i ? x + beyond(i) : now.q[at]))); }, () => fit(0));
  c.slide.min = low - spare; c.slide.max = high + spare;
  return () => {
    const x = k < T ? L.asked[k][i] : now.q[L.driven[i]] - beyond(i);
    c.fill(x, x * factor());
    c.label.textContent = symbolOf(name) + within(L.angles[i] ? degrees ? "°" : "rad" : D.unit);
  };
});
const shown = () => { driving.forEach(update => update()); rest(); };
{{SIZING}}
{{SHAPING}}
// The solver's pose becomes the one that is shown.
function take() {
  if (k === T || D.status[k] !== 0) return;
  if (poses[k]) now.q.set(poses[k]); else led(askedOf(k));
}
{{SWITCHING}}
const rated = ["speed", "acceleration"].flatMap((noun, order) => D.points.flatMap((p, column) => p.moves && L.rates.length > order ? [{
  text: `${noun} of ${p.name}`, unit: D.unit + "/s" + (order ? "²" : ""),
  at: i => { whole(); const v = D.status[i] ? null : rateOf(i, column, order); return v && hypot(...v); },
}] : []));
// Poses are solved to the last digit, with rates, once asked for, as far as they are on the branch of the first.
function whole() {
  if (wholly || designed) return;
  wholly = true;
  for (const by of [1, -1]) { const q = now.q.slice(); for (let pose = L.start; pose < T && D.status[pose] === 0 && S.follow(q, now.c, L.asked[pose]) && D.points.every((p, i) => axes.every((axis, j) => abs(placeIn(q, i)[j] - p[axis][pose]) < 1e-5 * L.length)); pose += by) note(pose, poses[pose] = q.slice()); }
}
sizes();
const between = (pose, column) => designed && betweens[pose] ? betweens[pose].map(q => placeIn(q, column)) : [];
// For scripts on the page: all coordinates where the inputs are led to, or null; and as they are now.
const solve = target => { take(); const good = led(target); present(); return good ? [...now.q] : null; }, design = () => ({ q: [...now.q], dimensions: [...now.d] }), plotted = () => Object.fromEntries(D.series.map(s => [s.symbol, s.values[k] ?? null]));
return { altered: () => designed, exerts: () => !loose(k), between, shown, grips, rates: () => rated, now, solve, design, plotted, take, back, present, remember, fit, whole, askedOf, markersAt, drawing, everywhere };
