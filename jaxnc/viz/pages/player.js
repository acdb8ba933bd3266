"use strict";
// A motion D in a root that holds the body of a page: a document, or the shadow root of a widget.
const page = (root, D, model) => {
const { hypot, max, min, abs, round, PI, sqrt, floor, ceil, sign, cos, sin, atan2, log10 } = Math;
const last = D.poses - 1, axes = ["x", "y", "z"].slice(0, D.dim), turn = 2 * PI;
// Values over the poses, as they were packed: differences of some order in digits of five bits, ends of an even row, or one number for all.
const unpacked = (x, length = D.poses) => {
  if (!x.steps) return Array.isArray(x) ? x : Array.from({ length }, (_, i) => x.to === undefined ? x : i === last ? x.to : x.from + i * ((x.to - x.from) / last));
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
// Columns: points and markers, directions, and of arrows the tips, and the feet that are no points.
const columns = [...D.points, ...D.directions, ...D.tips];
for (const p of [...columns, ...Object.values(D.fine)]) for (const axis of axes) p[axis] = unpacked(p[axis], p.count);
for (const s of [...D.scalars, ...D.series]) s.values = unpacked(s.values);
if (D.time) D.time = unpacked(D.time);
const owner = root.host || root.documentElement, until = new AbortController(), $ = id => root.getElementById(id), raf = f => requestAnimationFrame(f);
const el = (tag, more, ...inner) => { const node = Object.assign(document.createElement(tag), more); node.append(...inner); return node; };
const on = (node, kinds, f, more) => { for (const kind of kinds.split(" ")) node.addEventListener(kind, f, { signal: until.signal, ...more }); };
const give = (node, attributes) => { for (const name in attributes) if (name === "style") node.style.cssText = attributes.style; else node.setAttribute(name, attributes[name]); };
const space = "http://www.w3.org/2000/svg", make = (tag, attributes, parent, text) => {
  const node = document.createElementNS(space, tag);
  give(node, attributes);
  if (text) node.textContent = text;
  parent?.append(node);
  return node;
};
const line = (parent, kind, x1, y1, x2, y2) => make("line", { class: kind, x1, y1, x2, y2 }, parent);
const write = (parent, x, y, text, anchor) => make("text", { x, y, "text-anchor": anchor }, parent, text);
const seen = (node, yes) => give(node, { visibility: yes ? "visible" : "hidden" });
const cell = (row, text) => Object.assign(row.insertCell(), { textContent: text });
const paint = (name, body) => `var(--${name}-${body < 0 ? "ink" : body % 10})`;
const decimals = min(12, max(0, 4 - floor(log10(D.size))));
const minus = text => text.replace(/^-(0\.?0*)$/, "$1").replace("-", "−"), fixed = (v, digits) => v == null ? "–" : minus(v.toFixed(digits)), number = v => fixed(v, decimals);
const within = unit => unit ? ` [${unit}]` : "";
// Steps of 1, 2 or 5 between two values, at most so many, and the decimals they need.
const stepped = raw => { const power = 10 ** floor(log10(raw)), step = [1, 2, 5, 10].map(s => s * power).find(s => s >= raw * (1 - 1e-9)); return [step, max(0, -floor(log10(step) + 1e-9))]; };
// An angle in the turn above the least that is drawn; one of a whole turn is none.
const swept = (x, low) => { const angle = ((x - low) % turn + turn) % turn + low; return abs(angle) > turn - 1e-6 ? angle - sign(angle) * turn : angle; };

// Where the motion is now (the nearest pose of the slider too), and which points leave a trace. The stage draws: layout(),
// drawPose(failed, placed), drawTraces().
let k = 0, nearest = 0, degrees = D.degrees, handled = null, told = () => {};
const traces = new Set(D.traces);
const placed = column => Array.isArray(column) ? column : axes.map(axis => columns[column][axis][k]);
const put = (column, pose, place) => axes.forEach((axis, j) => { columns[column][axis][pose] = place[j]; });
// Places of a column on its way, with those between the poses where these are few; null where it breaks off.
const path = column => {
  const fine = !handled?.altered() && D.fine[column], p = fine || columns[column], out = [];
  for (let i = 0; i < (fine ? fine.x.length : D.poses); i++) if (fine || D.status[i] !== "waiting") {
    out.push(p.x[i] === null || !fine && D.status[i] ? null : axes.map(axis => p[axis][i]));
    if (!fine && handled) out.push(...handled.between(i, column));
  }
  return out;
};
const curve = points => {
  let d = "", before = null;
  for (const p of points) { if (p) d += (before ? "L" : "M") + p.map(x => x.toFixed(2)).join(" "); before = p; }
  return d;
};
const textOf = (s, v) => v == null ? "–" : s.angle ? degrees ? fixed(v * 180 / PI, 2) + "°" : fixed(v, 4) + " rad"
  : (s.unit === "s" ? fixed(v, 4) : number(v)) + (s.unit ? " " + s.unit : "");
{{FORCES}}
{{STAGE}}
const rows = { scalars: [], points: [] };
function tables() {
  const given = D.inputs.map(([symbol, column, axis]) => ({ symbol, unit: D.unit, driven: true, values: columns[column][axis] }));
  if (D.time) given.unshift({ symbol: "time", unit: "s", driven: true, values: D.time });
  for (const s of [...given, ...D.scalars.filter(s => s.driven), ...D.scalars.filter(s => !s.driven)]) {
    const row = $("scalars").insertRow();
    if (s.driven) row.className = "input";
    cell(row, s.symbol + (s.driven && s.symbol !== "time" ? " (input)" : ""));
    rows.scalars.push([cell(row, ""), s]);
  }
  $("values").hidden = !rows.scalars.length;
  for (const axis of axes) $("heads").append(el("th", {}, axis + within(D.unit)));
  [...D.points, ...D.directions].forEach((p, column) => {
    const row = $("points").insertRow(), point = column < D.points.length, called = p.trade ? `${p.name} ${p.trade}` : p.name, name = cell(row, called);
    if (!point) name.className = "vector";
    else if (p.moves) {
      const box = el("input", { type: "checkbox", checked: traces.has(column) });
      box.style.accentColor = paint("body", p.body);
      on(box, "change", () => { traces[box.checked ? "add" : "delete"](column); drawTraces(); });
      name.replaceChildren(el("label", {}, box, called));
    }
    rows.points.push([axes.map(() => cell(row, "")), p, point ? number : x => fixed(x, 4)]);
  });
}
let said = "";  // of the pose that is shown
const banner = text => { $("banner").hidden = !text; $("banner").textContent = text; }, say = text => { banner(said = text); };
function show(pose) {
  if (pose !== k) said = "";
  k = pose;
  if (k < D.poses) nearest = k;
  const failed = D.status[k] !== 0 && D.status[k] !== "waiting";
  drawPose(failed, D.points.every(p => axes.every(axis => p[axis][k] !== null)));
  banner(failed ? `Pose ${k} failed. ` + (D.sentences[D.status[k]] || "") : said);
  $("slider").value = nearest;
  $("count").textContent = (k === nearest ? "" : "≈ ") + (D.time ? `${+D.time[nearest].toPrecision(4)} s` : `${nearest} / ${last}`);
  for (const [td, s] of rows.scalars) td.textContent = failed && s.symbol !== "time" ? "–" : textOf(s, s.values[k]);
  for (const [cells, p, text] of rows.points) axes.forEach((axis, i) => { cells[i].textContent = failed && p.moves ? "–" : text(p[axis][k]); });
  owner.dataset.pose = k;
  cursor(); told();
  handled?.shown();
}
let playing = false, way = 1, clock = 0;
const step = by => { pause(); show(min(last, max(0, nearest + by))); };
const pause = () => { playing = false; $("play").textContent = "Play"; }, speed = () => $("speed").value / 1000;
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
  const rate = D.fps * speed(), count = floor((now - clock) * rate);
  if (count > 0) {
    clock += count / rate;
    let next = nearest + way * count;
    if (D.closed) next = (next % last + last) % last;
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
on($("slider"), "input", event => { pause(); show(+event.target.value); });
const chorded = event => event.ctrlKey || event.metaKey || event.altKey, ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
on(root, "keydown", event => {
  if (chorded(event) || event.target.tagName === "SELECT") return;
  const by = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10, Home: -Infinity, End: Infinity }[event.key];
  if (by) step(by);
  else if (event.key === " " && event.target.tagName !== "BUTTON" && event.target.type !== "checkbox") toggle();
  else return;
  event.preventDefault();
});
function strip() {
  const edges = D.status.slice(0, D.poses).map((s, i) => `${s ? "var(--failure)" : "transparent"} ${(100 * i / D.poses).toFixed(3)}% ${(100 * (i + 1) / D.poses).toFixed(3)}%`);
  $("strip").style.background = `linear-gradient(to right,${edges})`;
}
strip();
if (last < 1) $("controls").style.display = "none";
{{CHARTS}}
tables();
{{LIVE}}
const wanted = !root.host && /^#(\d+)$/.exec(location.hash);
if (wanted) k = min(last, +wanted[1]);
layout();
charts();
new ResizeObserver(layout).observe($("drawing"));
{{MORE}}
return { ...handled, layout, end: () => { pause(); until.abort(); } };
};
