"use strict";
// A page to draw a curve on: machines of an embedded atlas whose curves are like it, and, with Python behind it, those that a search finds.
const { hypot, max, min, abs, PI, sqrt, cos, sin, atan2, round, floor } = Math, D = JSON.parse(document.getElementById("data").textContent);
const $ = id => document.getElementById(id), space = "http://www.w3.org/2000/svg", POSES = 64, HARMONICS = 10, WAVES = 14, SHIFTS = 64, NEAR = 300, SHOWN = 8;
const give = (node, attributes) => { for (const name in attributes) node.setAttribute(name, attributes[name]); return node; };
const make = (tag, attributes, parent) => parent.appendChild(give(document.createElementNS(space, tag), attributes));
// Places and numbers of two parts.
const add = (a, b) => [a[0] + b[0], a[1] + b[1]], less = (a, b) => [a[0] - b[0], a[1] - b[1]], times = (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
const scaled = (a, k) => [a[0] * k, a[1] * k], conj = a => [a[0], -a[1]], way = angle => [cos(angle), sin(angle)], far = (a, b) => hypot(a[0] - b[0], a[1] - b[1]);

// The frames of a dyad's links; as jaxnc/synthesis/tracing/atlas.py.
function close(kind, sign, p, q, u, w, m, n) {
  const v = less(q, p), square = v[0] ** 2 + v[1] ** 2;
  if (kind === 0) {
    const along = (square + m * m - n * n) / (2 * square), inner = add(p, times(v, [along, sign * sqrt(max(m * m / square - along ** 2, 0))]));
    return [[p, scaled(less(inner, p), 1 / m)], [q, scaled(less(inner, q), 1 / n)], inner];
  }
  if (kind === 1) {
    const line = times(w, way(n)), foot = times(less(p, q), conj(line)), inner = add(q, scaled(line, foot[0] + sign * sqrt(max(m * m - foot[1] ** 2, 0))));
    return [[p, scaled(less(inner, p), 1 / m)], [inner, line], inner];
  }
  if (kind === 2) {
    const reach = [sign * sqrt(max(square - m * m, 0)), m], along = scaled(times(v, conj(reach)), 1 / (reach[0] ** 2 + m * m));
    return [[p, along], [q, along], q];
  }
  const first = times(u, way(m)), second = times(w, way(n)), inner = add(p, scaled(first, times(v, conj(second))[1] / times(first, conj(second))[1]));
  return [[inner, first], [inner, second], inner];
}
// A machine where its crank has an angle: its tracing point, and the joints on each of its bodies.
function pose(machine, theta) {
  const frames = [[[0, 0], [1, 0]], [[0, 0], way(theta)]], on = [[], [[0, 0]]], x = machine.design;
  machine.dyads.forEach(([kind, a, b], d) => {
    const r = x.slice(6 * d), one = 2 + 2 * d, p = add(frames[a][0], times(frames[a][1], r)), q = add(frames[b][0], times(frames[b][1], r.slice(2)));
    const [first, second, inner] = close(kind, machine.sign[d], p, q, frames[a][1], frames[b][1], r[4], r[5]);
    frames.push(first, second); on.push([], []);
    on[a].push(p); on[b].push(q);
    if (kind < 3) on[one].push(p);
    if (kind === 0 || kind === 2) on[one + 1].push(q);
    if (kind === 2) on[one].push(q); else { on[one].push(inner); on[one + 1].push(inner); }
  });
  const [o, e] = frames[machine.tracer], point = add(o, times(e, x.slice(-2))), put = z => add(machine.place, times(machine.factor, z));
  on[machine.tracer].push(point);
  on[0].push([0, 0]);
  return { point: put(point), on: on.map(places => places.map(put)) };
}
const angles = (machine, count) => Array.from({ length: count + 1 }, (_, i) => machine.begin + machine.span * i / count);
const curveOf = (machine, count = POSES) => angles(machine, count).map(theta => pose(machine, theta).point);

// Fourier coefficients by arc length, as jaxnc/synthesis/tracing/atlas.py; corners of closed curves end in the first one.
function coefficients(corners, closed) {
  const steps = corners.slice(1).map((p, i) => less(p, corners[i])), long = steps.map(s => hypot(...s)), total = long.reduce((a, b) => a + b, 0) || 1;
  const middles = steps.map((s, i) => add(corners[i], scaled(s, 0.5))), centre = middles.reduce((c, p, i) => add(c, scaled(p, long[i] / total)), [0, 0]), out = [];
  let before = 0;
  const at = long.map(x => (before += x) - x / 2).map(x => x / total);
  const orders = closed ? [...Array(2 * HARMONICS + 1).keys()].map(k => k - HARMONICS).filter(k => k) : [...Array(WAVES).keys()].map(k => k + 1);
  for (const k of orders) out.push(middles.reduce((c, p, i) => add(c, scaled(closed ? times(less(p, centre), way(-2 * PI * k * at[i])) : scaled(less(p, centre), 2 * cos(PI * k * at[i])), long[i] / total)), [0, 0]));
  const size = sqrt(out.reduce((s, c) => s + c[0] ** 2 + c[1] ** 2, 0)) || 1;
  const spread = sqrt(middles.reduce((s, p, i) => s + long[i] / total * far(p, centre) ** 2, 0)) || 1;
  return { c: out.map(c => scaled(c, 1 / size)), centre, spread };
}
const backwards = (c, closed) => closed ? [...c].reverse() : c.map((z, i) => scaled(z, i % 2 ? 1 : -1));
const mirrored = (c, closed) => closed ? [...c].reverse().map(conj) : c.map(conj);
// How a curve is laid on a target: what of it fits, by which angle it is turned, and whether it is mirrored first.
function lay(goal, own, closed) {
  let best = { fit: -1 };
  [own, backwards(own, closed), mirrored(own, closed), backwards(mirrored(own, closed), closed)].forEach((c, i) => {
    const product = goal.map((z, j) => times(z, conj(c[j])));
    for (let shift = 0; shift < (closed ? SHIFTS : 1); shift++) {
      let sum = [0, 0];
      product.forEach((z, j) => { const k = j < HARMONICS ? j - HARMONICS : j - HARMONICS + 1; sum = add(sum, closed ? times(z, way(2 * PI * k * shift / SHIFTS)) : z); });
      const fit = hypot(...sum);
      if (fit > best.fit) best = { fit, turn: atan2(sum[1], sum[0]), mirrored: i > 1 };
    }
  });
  return best;
}
function mirror(machine) {
  const design = machine.design.map((x, i) => {
    const kind = machine.dyads[floor(i / 6)]?.[0], which = i % 6;
    if (kind === undefined) return i === machine.design.length - 1 ? -x : x;
    return which === 1 || which === 3 || which === 4 && kind > 1 || which === 5 && kind > 0 ? -x : x;
  });
  return { ...machine, design, sign: machine.sign.map(s => -s), begin: 0 - machine.begin, span: -machine.span };
}
// The atlas, with its coefficients once they are asked for.
const atlas = D.rows.map(([chain, begin, span, ...rest]) => {
  const [name, tracer, dyads] = D.chains[chain];
  return { name, tracer, dyads, sign: rest.slice(0, dyads.length), design: rest.slice(dyads.length), begin, span, place: [0, 0], factor: [1, 0] };
});
const known = {};
function descriptors(closed) {
  return known[closed] ??= atlas.map(machine => {
    const one = closed ? { ...machine, begin: 0, span: 2 * PI } : machine;
    return { machine: one, ...coefficients(curveOf(one), closed) };
  });
}
const sizes = c => c.map(z => hypot(...z));
function nearest(p, line) {
  let least = Infinity;
  for (let i = 1; i < line.length; i++) {
    const a = line[i - 1], d = less(line[i], a), t = max(0, min(1, ((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / (d[0] ** 2 + d[1] ** 2 || 1)));
    least = min(least, far(p, add(a, scaled(d, t))));
  }
  return least;
}
function evenly(line, count) {
  const along = [0];
  for (let i = 1; i < line.length; i++) along.push(along[i - 1] + far(line[i], line[i - 1]));
  let i = 1;
  return Array.from({ length: count }, (_, j) => {
    const s = along[along.length - 1] * j / (count - 1);
    while (i < line.length - 1 && along[i] < s) i++;
    return add(line[i - 1], scaled(less(line[i], line[i - 1]), (s - along[i - 1]) / (along[i] - along[i - 1] || 1)));
  });
}
const distance = (a, b) => [[a, b], [b, a]].reduce((sum, [p, q]) => sum + evenly(p, 100).reduce((s, x) => s + nearest(x, q), 0) / 100, 0);
// Machines of the atlas for a curve, the nearest first.
function lookUp(points, closed) {
  const line = evenly(closed ? [...points, points[0]] : points, 129), goal = coefficients(line, closed), all = descriptors(closed), want = sizes(goal.c), back = [...want].reverse();
  const rough = all.map((own, i) => { const s = sizes(own.c); return [min(...[want, closed ? back : want].map(w => w.reduce((sum, x, j) => sum + (x - s[j]) ** 2, 0))), i]; });
  const laid = rough.sort((a, b) => a[0] - b[0]).slice(0, NEAR).map(([, i]) => ({ own: all[i], ...lay(goal.c, all[i].c, closed) })).sort((a, b) => b.fit - a.fit).slice(0, 3 * SHOWN);
  return laid.map(({ own, turn, mirrored }) => {
    const machine = mirrored ? mirror(own.machine) : own.machine, centre = mirrored ? conj(own.centre) : own.centre;
    const factor = scaled(way(turn), goal.spread / own.spread), put = { ...machine, factor, place: less(goal.centre, times(factor, centre)), closed };
    return { ...put, distance: distance(curveOf(put), line) / goal.spread };
  }).sort((a, b) => a.distance - b.distance).slice(0, SHOWN);
}

// -- the page -----------------------------------------------------------------------------------------------------------
const text = (line, shut) => line.map((p, i) => `${i ? "L" : "M"}${p[0].toFixed(3)} ${(-p[1]).toFixed(3)}`).join("") + (shut ? "Z" : "");
let target = [], closed = false, machines = [], chosen = null, theta = 0, playing = false, run = 0;
const pad = $("pad"), stage = $("drawing"), ink = make("path", { class: "target" }, pad);
const draw = () => give(ink, { d: target.length ? text(target, closed) : "" });
const spot = (svg, event) => { const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()); return [p.x, -p.y]; };
give(pad, { viewBox: "-150 -100 300 200" });
let drawing = false;
pad.addEventListener("pointerdown", event => { if (event.button || drawing) return; event.preventDefault(); drawing = true; pad.setPointerCapture(event.pointerId); target = [spot(pad, event)]; closed = false; draw(); });
pad.addEventListener("pointermove", event => { if (!drawing) return; const p = spot(pad, event); if (far(p, target[target.length - 1]) > 0.5) { target.push(p); draw(); } });
pad.addEventListener("pointercancel", () => { drawing = false; wipe(ASK); });
pad.addEventListener("pointerup", () => {
  if (!drawing) return;
  drawing = false;
  const long = target.slice(1).reduce((s, p, i) => s + far(p, target[i]), 0);
  if (target.length < 4 || long < 10) { wipe("That is no curve yet: draw a longer one."); return; }
  closed = far(target[0], target[target.length - 1]) < 0.12 * long;
  $("closed").checked = closed;
  find();
});
$("closed").addEventListener("change", event => { closed = event.target.checked; if (target.length > 3) find(); });
const ASK = "Draw a curve here, with the mouse or a finger.";
const wipe = say => { run++; target = []; machines = []; chosen = null; draw(); list(); show(); $("said").textContent = say; };
$("clear").addEventListener("click", () => wipe(ASK));
async function find() {
  const mine = ++run, begun = performance.now();
  draw();
  machines = lookUp(target, closed);
  $("said").textContent = `${machines.length} of ${atlas.length} machines, found in ${round(performance.now() - begun)} ms`;
  list(); choose(machines[0]);
  if (!D.live) return;
  for (const seconds of D.live) {
    $("said").textContent = `searching for ${seconds} s …`;
    try {
      const answer = await fetch("trace", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ points: target, closed, seconds }) }), told = await answer.json();
      if (mine !== run) return;
      if (!answer.ok) { $("said").textContent = told.error; return; }
      const at = chosen === machines[0] ? 0 : -1;
      machines = told.designs; list();
      if (at === 0 && machines.length) choose(machines[0]);
      $("said").textContent = told.said;
    } catch { $("said").textContent = "Python does not answer: what the page knows by itself is shown."; return; }
  }
}
function list() {
  $("machines").replaceChildren(...machines.map(machine => {
    const card = document.createElement("button"), line = curveOf(machine, 90), svg = make("svg", { viewBox: frame([...line, ...target]) }, card);
    make("path", { class: "target", d: text(target, closed) }, svg); make("path", { class: "curve", d: text(line) }, svg);
    card.type = "button"; card.append(`${machine.name}, ${machine.distance.toPrecision(2)}`);
    card.addEventListener("click", () => choose(machine));
    machine.card = card;
    return card;
  }));
}
function frame(places) {
  const [x, y] = [0, 1].map(k => places.map(p => k ? -p[1] : p[0])), low = [min(...x), min(...y)], wide = max(...x) - low[0], high = max(...y) - low[1], spare = 0.08 * max(wide, high) + 1e-9;
  return `${low[0] - spare} ${low[1] - spare} ${wide + 2 * spare} ${high + 2 * spare}`;
}
function choose(machine) {
  for (const one of machines) one.card.setAttribute("aria-pressed", one === machine);
  chosen = machine; theta = machine ? machine.begin : 0;
  show();
}
// The machine where it is now. Its joints are dragged: the crank goes where the joint is nearest to the pointer.
let held = null, box = null;
function show() {
  if (box !== chosen) {
    box = chosen; stage.replaceChildren();
    $("title").textContent = chosen ? `${chosen.name}: ${chosen.distance.toPrecision(3)} of the curve's size` : "";
    $("files").replaceChildren(...(chosen?.links || []).flatMap(([name, href]) => { const a = document.createElement("a"); a.href = href; a.textContent = name; a.target = "_blank"; return [a, " "]; }));
    if (!chosen) return;
    const line = curveOf(chosen, 180), all = angles(chosen, 24).flatMap(t => pose(chosen, t).on.flat());
    give(stage, { viewBox: frame([...line, ...target, ...all]) });
    make("path", { class: "target", d: text(target, closed) }, stage); make("path", { class: "curve", d: text(line) }, stage);
    const now = pose(chosen, theta), unit = stage.viewBox.baseVal, r = 0.011 * max(unit.width, unit.height);
    chosen.nodes = now.on.map((_, body) => body ? make("path", { class: "link", style: `fill:var(--body-${(body - 1) % 10});stroke:var(--body-${(body - 1) % 10})` }, stage) : null);
    chosen.joints = now.on.map((places, body) => places.map((_, i) => {
      make("circle", { class: "joint", r }, stage);
      const grip = make("circle", { class: "grip", r: 2.5 * r, "data-body": body, "data-joint": i }, stage);
      grip.addEventListener("pointerdown", event => { event.preventDefault(); playing = false; label(); held = [body, i]; grip.setPointerCapture(event.pointerId); });
      grip.addEventListener("pointermove", event => { if (held) pull(spot(stage, event)); });
      grip.addEventListener("lostpointercapture", () => { held = null; });
      return [grip.previousSibling, grip];
    }));
  }
  if (!chosen) return;
  const now = pose(chosen, theta);
  now.on.forEach((places, body) => {
    if (body) give(chosen.nodes[body], { d: text(places, true) });
    places.forEach(([x, y], i) => { for (const node of chosen.joints[body][i]) give(node, { cx: x, cy: -y }); });
  });
  document.documentElement.dataset.theta = theta;
}
function pull(place) {
  let best = theta, least = far(pose(chosen, theta).on[held[0]][held[1]], place);
  // Near where it is, so that it does not jump to the other side of the curve.
  for (let i = -30; i <= 30; i++) {
    const share = theta + i * PI / 180, angle = abs(chosen.span) > 6.28 ? share : max(min(chosen.begin, chosen.begin + chosen.span), min(max(chosen.begin, chosen.begin + chosen.span), share));
    const gap = far(pose(chosen, angle).on[held[0]][held[1]], place);
    if (gap < least - 1e-12) { least = gap; best = angle; }
  }
  theta = best; show();
}
const label = () => { $("play").textContent = playing ? "Pause" : "Play"; };
$("play").addEventListener("click", () => { playing = !playing; label(); if (playing) requestAnimationFrame(tick); });
let clock = 0;
function tick(now) {
  if (!playing || !chosen) return;
  clock += min(0.05, 0.001 * (now - (tick.last ?? now))); tick.last = now;
  const turn = clock / 3, whole = abs(chosen.span) > 6.28;
  theta = chosen.begin + chosen.span * (whole ? turn % 1 : 1 - abs(turn % 2 - 1));
  show(); requestAnimationFrame(tick);
}
window.jaxnc = { lookUp, curveOf, machines: () => machines, chosen: () => chosen, atlas };
