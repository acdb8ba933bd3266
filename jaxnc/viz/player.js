"use strict";
// A motion D in a root that holds the body of a page: a document, or the shadow root of a widget.
const page = (root, D, model) => {
const { hypot, max, min, abs, round, PI, sqrt, floor, ceil, sign, cos, sin, atan2, log10 } = Math;
// Values over the poses, as they were packed: differences of some order in digits of five bits, ends of an even row, or one number for all.
const unpacked = x => {
  if (typeof x === "number") return new Array(D.poses).fill(x);
  if (x.to !== undefined) return Array.from({ length: D.poses }, (_, i) => i === D.poses - 1 ? x.to : x.from + i * ((x.to - x.from) / (D.poses - 1)));
  if (!x.steps) return x;
  const out = [], ahead = new Array(x.order).fill(0);
  let step = 0, place = 1;
  for (const c of x.steps) {
    const digit = c.charCodeAt() - 63;
    if (digit < 0) { out.push(null); ahead.fill(0); continue; }
    step += digit % 32 * place; place *= 32;
    if (digit > 31) continue;
    let whole = step % 2 ? -(step + 1) / 2 : step / 2;
    for (let j = x.order; j--;) whole = ahead[j] += whole;
    out.push(x.quantum < 1 ? whole / round(1 / x.quantum) : whole * x.quantum); step = 0; place = 1;
  }
  return out;
};
const axes = ["x", "y", "z"].slice(0, D.dim);
for (const p of [...D.points, ...(D.directions || []), ...(D.tips || [])]) for (const axis of axes) p[axis] = unpacked(p[axis]);
const turned = rows => { const all = rows.map(unpacked); return all[0].map((_, pose) => all.map(row => row[pose])); };
if (D.dim === 2) for (const a of D.arrows) a.vectors = a.vectors.map(turned);
for (const s of [...D.scalars, ...D.series]) s.values = unpacked(s.values);
for (const scalar in D.turns || {}) D.turns[scalar] = unpacked(D.turns[scalar]);
const owner = root.host || root.documentElement, until = new AbortController(), $ = id => root.getElementById(id), el = tag => document.createElement(tag), raf = f => requestAnimationFrame(f);
const on = (node, kind, f, more) => node.addEventListener(kind, f, { signal: until.signal, ...more });
const give = (node, attributes) => { for (const name in attributes) node.setAttribute(name, attributes[name]); };
const space = "http://www.w3.org/2000/svg", make = (tag, attributes, parent, text) => {
  const node = document.createElementNS(space, tag);
  give(node, attributes);
  if (text !== undefined) node.textContent = text;
  parent?.appendChild(node);
  return node;
};
// A line through the poses that are right; those that are still sought leave no gap.
const curve = (right, at, count = D.poses) => {
  let d = "", pen = false;
  for (let i = 0; i < count; i++) if (D.status[i] !== "waiting") {
    const good = right(i);
    if (good) d += (pen ? "L" : "M") + at(i).map(x => x.toFixed(2));
    pen = good;
  }
  return d;
};
const cell = (row, text) => { const td = el("td"); td.textContent = text; row.appendChild(td); return td; };
const paint = (name, body) => {
  if (!name) return "none";
  if (name === "body" || name === "tint") return `var(--${name}-${body < 0 ? "ink" : body % 10})`;
  return `var(--${name})`;
};
const decimals = min(12, max(0, 4 - floor(log10(D.size))));
const minus = text => text.replace(/^-(0\.?0*)$/, "$1").replace("-", "−"), angleText = (v, digits) => v == null ? "–" : minus(v.toFixed(digits)), number = v => angleText(v, decimals);

// Where the motion is now (the nearest pose of the slider too), and which points leave a trace. The stage draws: layout(),
// drawPose(failed, placed), drawTraces().
let k = 0, nearest = 0, degrees = D.degrees;
const traces = new Set(D.traces);
const textOf = (s, v) => v == null ? "–" : s.angle ? degrees ? angleText(v * 180 / PI, 2) + "°" : angleText(v, 4) + " rad"
  : (s.unit === "s" ? angleText(v, 4) : number(v)) + (s.unit ? " " + s.unit : "");
let told = () => {};
{{FORCES}}
{{STAGE}}
const rows = { scalars: [], points: [] };
function tables() {
  const ordered = [...D.scalars.filter(s => s.driven), ...D.scalars.filter(s => !s.driven)];
  const spread = D.inputs.map(name => { const dot = name.lastIndexOf("."), p = D.points.find(q => q.name === name.slice(0, dot));
    return p && { symbol: name, unit: D.unit, driven: true, values: p[name.slice(dot + 1)] }; }).filter(Boolean);
  const time = D.time ? [{ symbol: "time", unit: "s", driven: true, values: D.time }] : [];
  for (const s of [...time, ...spread, ...ordered]) {
    const row = $("scalars").insertRow();
    if (s.driven) row.className = "input";
    cell(row, s.symbol + (s.driven && s.symbol !== "time" ? " (input)" : ""));
    rows.scalars.push([cell(row, ""), s]);
  }
  if (!rows.scalars.length) $("values").hidden = true;
  for (const axis of axes) {
    const th = el("th");
    th.textContent = D.unit ? `${axis} [${D.unit}]` : axis;
    $("heads").appendChild(th);
  }
  D.points.forEach((p, column) => {
    const row = $("points").insertRow(), name = cell(row, ""), called = p.trade ? `${p.name} ${p.trade}` : p.name;
    if (p.moves) {
      const label = el("label"), box = el("input");
      box.type = "checkbox"; box.checked = traces.has(column);
      box.style.accentColor = paint("body", p.body);
      on(box, "change", () => { if (box.checked) traces.add(column); else traces.delete(column); drawTraces(); });
      label.append(box, called); name.appendChild(label);
    } else name.textContent = called;
    rows.points.push([axes.map(() => cell(row, "")), p, number]);
  });
  for (const v of D.directions || []) {
    const row = $("points").insertRow();
    cell(row, v.name).className = "vector";
    rows.points.push([axes.map(() => cell(row, "")), v, x => angleText(x, 4)]);
  }
}
function show(pose) {
  k = pose;
  if (k < D.poses) nearest = k;
  const failed = D.status[k] !== 0 && D.status[k] !== "waiting", placed = D.points.every(p => axes.every(axis => p[axis][k] !== null));
  drawPose(failed, placed);
  $("banner").hidden = !failed;
  if (failed) $("banner").textContent = `Pose ${k} failed. ` + (D.sentences[D.status[k]] || "");
  $("slider").value = nearest;
  $("count").textContent = (k === nearest ? "" : "≈ ") + (D.time ? `${+D.time[nearest].toPrecision(4)} s` : `${nearest} / ${D.poses - 1}`);
  for (const [td, s] of rows.scalars) td.textContent = failed && s.symbol !== "time" ? "–" : k >= s.values.length ? "–" : textOf(s, s.values[k]);
  for (const [cells, p, text] of rows.points) axes.forEach((axis, i) => { cells[i].textContent = failed && p.moves ? "–" : text(p[axis][k]); });
  owner.dataset.pose = k;
  cursor(); told();
  handled?.shown();
}
let playing = false, way = 1, clock = 0;
const last = D.poses - 1;
const step = by => { pause(); show(min(last, max(0, nearest + by))); };
function pause() { playing = false; $("play").textContent = "Play"; }
function play() {
  if (last < 1) return;
  playing = true; $("play").textContent = "Pause"; clock = performance.now();
  if (D.time) begin();
  else if (!D.closed && nearest === last) way = -1;
  raf(tick);
}
function tick(now) {
  if (!playing) return;
  if (D.time) return timed(now);
  const count = floor((now - clock) * D.fps * Number($("speed").value) / 1000);
  if (count > 0) {
    clock += count * 1000 / (D.fps * Number($("speed").value));
    let next = nearest + way * count;
    if (D.closed) next = ((way > 0 ? next : next + last) % last + last) % last;
    else if (next >= last) { next = last; way = -1; }
    else if (next <= 0) { next = 0; way = 1; }
    show(next);
  }
  raf(tick);
}
{{CLOCK}}
const toggle = () => playing ? pause() : play();
on($("play"), "click", toggle);
on($("back"), "click", () => step(-1));
on($("next"), "click", () => step(1));
$("slider").max = last;
on($("slider"), "input", event => { pause(); show(Number(event.target.value)); });
on(root, "keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
  const by = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10, Home: -Infinity, End: Infinity }[event.key];
  if (by !== undefined) step(by);
  else if (event.key === " " && event.target.tagName !== "BUTTON" && event.target.type !== "checkbox") toggle();
  else return;
  event.preventDefault();
});
function strip() {
  const edges = [];
  for (let i = 0; i < D.poses; i++) edges.push(`${D.status[i] ? "var(--failure)" : "transparent"} ${(100 * i / D.poses).toFixed(3)}% ${(100 * (i + 1) / D.poses).toFixed(3)}%`);
  $("strip").style.background = D.status.slice(0, D.poses).some(s => s) ? `linear-gradient(to right, ${edges.join(",")})` : "none";
}
strip();
if (last < 1) $("controls").style.display = "none";
{{CHARTS}}
tables();
let handled = null;
{{LIVE}}
const wanted = !root.host && /^#(\d+)$/.exec(location.hash);
if (wanted) k = min(last, Number(wanted[1]));
layout();
charts();
new ResizeObserver(layout).observe($("drawing"));
{{MORE}}
return { ...handled, layout, end: () => { pause(); until.abort(); } };
};
