// A quantity over the motion, with a cursor at the pose; and what can be taken away as a file.
const plotted = $("plot");
const angular = s => s.angle && degrees ? 180 / PI : 1, unitOf = s => s.angle ? degrees ? "°" : "rad" : s.unit;
const input = () => {
  const s = rows.scalars.map(x => x[1]).find(x => D.over && (x.name || x.symbol) === D.over);
  if (D.time) return { text: "time", unit: "s", at: i => D.time[i < D.poses ? i : nearest] };
  return s ? { text: s.symbol, unit: unitOf(s), at: i => s.values[i] * angular(s) } : { text: "pose", unit: "", at: i => i < D.poses ? i : nearest };
};
const quantities = () => [
  ...[...D.scalars, ...D.series].map(s => ({ text: s.symbol, unit: unitOf(s) + (s.per || ""), at: i => s.values[i] === null ? null : s.values[i] * angular(s), of: -1 })),
  ...D.points.flatMap((p, column) => p.moves ? axes.map(axis => ({ text: `${p.name}.${axis}`, unit: D.unit, at: i => p[axis][i], of: column })) : []),
  ...(handled ? handled.rates() : []),
];
let quantity = 0, series = null, frame = null;
const ticks = (low, high, most) => {
  const raw = (high - low) / most || 1, power = 10 ** floor(log10(raw)), step = [1, 2, 5, 10].map(s => s * power).find(s => s >= raw * (1 - 1e-9)), out = [];
  for (let i = ceil(low / step - 1e-6); i * step <= high + 1e-6 * step; i++) out.push(i * step);
  return [out, max(0, -floor(log10(step) + 1e-9))];
};
function graph() {
  const all = quantities(), x = input(), y = all[quantity];
  if (!y || D.poses < 2) return;
  const wide = plotted.clientWidth || 320, high = plotted.clientHeight || 190;
  plotted.replaceChildren(); give(plotted, { viewBox: `0 0 ${wide} ${high}` });
  const values = [], right = i => !D.status[i] && y.at(i) !== null && isFinite(y.at(i));
  for (let i = 0; i < D.poses; i++) if (right(i)) values.push([x.at(i), y.at(i)]);
  if (!values.length) { series = null; make("text", { x: 10, y: 24 }, plotted, "Known of the given motion only."); $("reading").textContent = "–"; return; }
  const range = j => { let a = Infinity, b = -Infinity; for (const v of values) { a = min(a, v[j]); b = max(b, v[j]); } const spare = b - a > 1e-12 * (abs(a) + abs(b)) ? 0 : abs(a) * 0.1 || 1; return [a - spare, b + spare]; };
  const [x0, x1] = range(0), [y0, y1] = range(1), box = [54, 10, wide - 18, high - 34], pad = 0.05 * (y1 - y0);
  const px = v => box[0] + (v - x0) / (x1 - x0) * (box[2] - box[0]), py = v => box[3] - (v - y0 + pad) / (y1 - y0 + 2 * pad) * (box[3] - box[1]);
  // An axis has some numbers, and angles in radians are read in parts of π.
  const turns = x.unit === "rad" ? PI : 1, [xs, xd] = ticks(x0 / turns, x1 / turns, max(4, wide / 90)), [ys, yd] = ticks(y0 - pad, y1 + pad, 6);
  for (const v of xs) { const at = px(v * turns); make("line", { x1: at, x2: at, y1: box[1], y2: box[3], class: "rule" }, plotted); make("text", { x: at, y: box[3] + 13, "text-anchor": "middle" }, plotted, minus(v.toFixed(xd)) + (turns > 1 && v ? "π" : "")); }
  for (const v of ys) { make("line", { x1: box[0], x2: box[2], y1: py(v), y2: py(v), class: "rule" }, plotted); make("text", { x: box[0] - 5, y: py(v) + 3.5, "text-anchor": "end" }, plotted, minus(yd > 4 || abs(v) >= 1e5 ? v.toPrecision(3) : v.toFixed(yd))); }
  make("text", { x: box[2], y: high - 5, "text-anchor": "end" }, plotted, x.text + (x.unit ? ` [${x.unit}]` : ""));
  make("path", { d: curve(right, i => [px(x.at(i)), py(y.at(i))]), class: "curve" }, plotted);
  series = { x, y, px, py, box };
  frame = [make("line", { y1: box[1], y2: box[3], class: "cursor" }, plotted), make("circle", { r: 3.5, class: "dot" }, plotted)];
  cursor();
}
function cursor() {
  if (!series || !frame) return;
  const a = series.x.at(k), b = series.y.at(k), hidden = b == null || !isFinite(b) || a == null || !isFinite(a);
  for (const node of frame) give(node, { visibility: hidden ? "hidden" : "visible" });
  $("reading").textContent = hidden ? "–" : `${minus(abs(b) >= 1e5 ? b.toExponential(3) : b.toPrecision(5))}${series.y.unit ? " " + series.y.unit : ""}`;
  if (hidden) return;
  const x = series.px(a);
  give(frame[0], { x1: x, x2: x }); give(frame[1], { cx: x, cy: series.py(b) });
}
function charts() {
  if (D.poses < 2) { $("graph").hidden = true; return; }
  const all = quantities(), list = $("quantity");
  all.forEach((q, i) => { const option = el("option"); option.value = i; option.textContent = q.text; list.append(option); });
  quantity = D.first;
  list.value = quantity;
  on(list, "change", () => { quantity = Number(list.value); graph(); });
  const pick = event => {
    if (!series || event.buttons === 0 && event.type === "pointermove") return;
    const at = event.clientX - plotted.getBoundingClientRect().left;
    let best = nearest, least = Infinity;
    for (let i = 0; i < D.poses; i++) { const gap = abs(series.px(series.x.at(i)) - at); if (gap < least) { least = gap; best = i; } }
    pause(); show(best);
  };
  on(plotted, "pointerdown", pick); on(plotted, "pointermove", pick);
  new ResizeObserver(graph).observe(plotted);
  graph();
}
$("degrees").checked = degrees;
on($("degrees"), "change", () => { degrees = $("degrees").checked; show(k); graph(); });
$("degrees").parentNode.hidden = !D.scalars.some(s => s.angle);

const save = (name, kind, text) => {
  const link = el("a");
  link.href = typeof text === "string" && text.startsWith("data:") ? text : URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  $("csv").after(link); link.click(); link.remove();  // in the document, where VS Code sees it and asks where to
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
};
const file = (D.title.replace(/[^\w-]+/g, "-").replace(/^-+|-+$/g, "") || "mechanism").slice(0, 60);
function tableText() {
  const shown = rows.scalars.map(x => x[1]).filter(s => s.values.length >= D.poses), head = (name, unit) => { const t = unit ? `${name} [${unit}]` : name; return /[",]/.test(t) ? '"' + t.replace(/"/g, '""') + '"' : t; };
  const text = (v, good) => good && v != null ? String(Number(v.toPrecision(12))) : "";
  const lines = [["pose", ...shown.map(s => head(s.name || s.symbol, unitOf(s))), ...D.points.flatMap(p => axes.map(a => head(p.name + "." + a, D.unit)))]];
  for (let i = 0; i < D.poses; i++) lines.push([i, ...shown.map(s => text(s.values[i] && s.values[i] * angular(s), !D.status[i])), ...D.points.flatMap(p => axes.map(a => text(p[a][i], !D.status[i] || !p.moves)))]);
  return lines.join("\n") + "\n";
}
function pictureText() {
  const drawn = $("drawing"), copied = drawn.cloneNode(true), from = drawn.querySelectorAll("*"), to = copied.querySelectorAll("*");
  const kept = "fill fill-opacity stroke stroke-width stroke-opacity stroke-dasharray stroke-linejoin stroke-linecap font-size font-style font-family paint-order visibility opacity".split(" ");
  to.forEach((node, i) => { const style = getComputedStyle(from[i]); node.style.cssText = kept.map(name => `${name}:${style.getPropertyValue(name)}`).join(";"); });
  for (const node of copied.querySelectorAll(".grip")) node.remove();
  give(copied, { xmlns: space });
  return new XMLSerializer().serializeToString(copied);
}
on($("csv"), "click", () => save(file + ".csv", "text/csv", tableText()));
on($("picture"), "click", () => D.dim === 2 ? save(file + ".svg", "image/svg+xml", pictureText()) : save(file + ".png", "image/png", $("drawing").toDataURL("image/png")));
$("picture").textContent = D.dim === 2 ? "SVG" : "PNG";
