"use strict";
(() => {
const D = JSON.parse(document.getElementById("data").textContent);
const $ = id => document.getElementById(id), axes = ["x", "y", "z"].slice(0, D.dim);
const cell = (row, text) => { const td = document.createElement("td"); td.textContent = text; row.appendChild(td); return td; };
const paint = (name, body) => {
  if (!name) return "none";
  if (name === "body" || name === "tint") return `var(--${name}-${body < 0 ? "ink" : body % 10})`;
  return `var(--${name})`;
};
const decimals = Math.min(12, Math.max(0, 4 - Math.floor(Math.log10(D.size))));
const number = v => v === null || v === undefined ? "–" : v.toFixed(decimals).replace(/^-(0\.?0*)$/, "$1").replace("-", "−");
const angleText = (v, digits) => v === null ? "–" : v.toFixed(digits).replace(/^-(0\.?0*)$/, "$1").replace("-", "−");

// Where the motion is now, and which points leave a trace. The stage draws: layout(), drawPose(failed, placed), drawTraces().
let k = 0;
const traces = new Set(D.traces);
{{STAGE}}
const rows = { scalars: [], points: [] };
function tables() {
  const ordered = [...D.scalars.filter(s => s.driven), ...D.scalars.filter(s => !s.driven)];
  const spread = D.inputs.map(name => { const dot = name.lastIndexOf("."), p = D.points.find(q => q.name === name.slice(0, dot));
    return p && { symbol: name, unit: D.lengthUnit, driven: true, values: p[name.slice(dot + 1)] }; }).filter(Boolean);
  const time = D.time ? [{ symbol: "time", unit: "s", driven: true, values: D.time }] : [];
  for (const s of [...time, ...spread, ...ordered]) {
    const row = $("scalars").insertRow();
    if (s.driven) row.className = "input";
    cell(row, s.symbol + (s.driven && s.symbol !== "time" ? " (input)" : ""));
    rows.scalars.push([cell(row, ""), s]);
  }
  if (!rows.scalars.length) $("values").hidden = true;
  for (const axis of axes) {
    const th = document.createElement("th");
    th.textContent = D.lengthUnit ? `${axis} [${D.lengthUnit}]` : axis;
    $("heads").appendChild(th);
  }
  D.points.forEach((p, column) => {
    const row = $("points").insertRow(), name = cell(row, "");
    if (p.moves) {
      const label = document.createElement("label"), box = document.createElement("input");
      box.type = "checkbox"; box.checked = traces.has(column);
      box.style.accentColor = paint("body", p.body);
      box.addEventListener("change", () => { if (box.checked) traces.add(column); else traces.delete(column); drawTraces(); });
      label.append(box, p.name); name.appendChild(label);
    } else name.textContent = p.name;
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
  const failed = D.status[k] !== 0, placed = D.points.every(p => axes.every(axis => p[axis][k] !== null));
  drawPose(failed, placed);
  $("banner").hidden = !failed;
  if (failed) $("banner").textContent = `Pose ${k} failed. ` + (D.sentences[D.status[k]] || "");
  $("slider").value = k;
  $("count").textContent = `${k} / ${D.poses - 1}`;
  for (const [td, s] of rows.scalars) {
    const v = s.values[k];
    td.textContent = failed && s.symbol !== "time" ? "–" : (s.unit === "°" ? angleText(v, 2) : s.unit === "rad" || s.unit === "s" ? angleText(v, 4) : number(v)) + (s.unit === "°" ? "°" : s.unit ? " " + s.unit : "");
  }
  for (const [cells, p, text] of rows.points) axes.forEach((axis, i) => { cells[i].textContent = failed && p.moves ? "–" : text(p[axis][k]); });
  document.documentElement.dataset.pose = k;
}
let playing = false, way = 1, clock = 0;
const last = D.poses - 1;
const step = by => { pause(); show(Math.min(last, Math.max(0, k + by))); };
function pause() { playing = false; $("play").textContent = "Play"; }
function play() {
  if (last < 1) return;
  playing = true; $("play").textContent = "Pause"; clock = performance.now();
  if (!D.closed && k === last) way = -1;
  requestAnimationFrame(tick);
}
function tick(now) {
  if (!playing) return;
  const count = Math.floor((now - clock) * D.fps * Number($("speed").value) / 1000);
  if (count > 0) {
    clock += count * 1000 / (D.fps * Number($("speed").value));
    let next = k + way * count;
    if (D.closed) next = ((way > 0 ? next : next + last) % last + last) % last;
    else if (next >= last) { next = last; way = -1; }
    else if (next <= 0) { next = 0; way = 1; }
    show(next);
  }
  requestAnimationFrame(tick);
}
const toggle = () => playing ? pause() : play();
$("play").addEventListener("click", toggle);
$("back").addEventListener("click", () => step(-1));
$("next").addEventListener("click", () => step(1));
$("slider").max = last;
$("slider").addEventListener("input", event => { pause(); show(Number(event.target.value)); });
document.addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
  const by = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10, Home: -Infinity, End: Infinity }[event.key];
  if (by !== undefined) step(by);
  else if (event.key === " " && event.target.tagName !== "BUTTON" && event.target.type !== "checkbox") toggle();
  else return;
  event.preventDefault();
});
const edges = [];
D.status.forEach((s, i) => {
  const c = s ? "var(--failure)" : "transparent";
  edges.push(`${c} ${(100 * i / D.poses).toFixed(3)}% ${(100 * (i + 1) / D.poses).toFixed(3)}%`);
});
if (D.status.some(s => s)) $("strip").style.background = `linear-gradient(to right, ${edges.join(",")})`;
if (last < 1) $("controls").style.display = "none";
tables();
const wanted = /^#(\d+)$/.exec(location.hash);
if (wanted) k = Math.min(last, Number(wanted[1]));
layout();
new ResizeObserver(layout).observe($("drawing"));
})();
