// A quantity over the motion, with a cursor at the pose; and what can be taken away as a file.
const plot = $("plot");
const angular = s => s.angle && degrees ? 180 / PI : 1, unitOf = s => s.angle ? degrees ? "°" : "rad" : s.unit;
const input = () => {
  const s = rows.scalars.map(x => x[1]).find(x => D.over && (x.name || x.symbol) === D.over), turning = i => i < D.poses ? i : nearest;
  if (D.time) return { text: "time", unit: "s", at: i => D.time[turning(i)] };
  return s ? { text: s.symbol, unit: unitOf(s), at: i => s.values[i] * angular(s) } : { text: "pose", at: turning };
};
const quantities = () => [
  ...[...D.scalars, ...D.series].map(s => ({ text: s.symbol, unit: unitOf(s) + (s.per || ""), at: i => s.values[i] === null ? null : s.values[i] * angular(s) })),
  ...D.points.flatMap(p => p.moves ? axes.map(axis => ({ text: `${p.name}.${axis}`, unit: D.unit, at: i => p[axis][i] })) : []),
  ...(handled ? handled.rates() : []),
];
let quantity = D.first, series = null, cursors = [];
const ticks = (low, high, most) => {
  const [step, digits] = stepped((high - low) / most || 1), out = [];
  for (let i = ceil(low / step - 1e-6); i * step <= high + 1e-6 * step; i++) out.push(i * step);
  return [out, digits];
};
const extent = (points, j) => points.reduce(([a, b], p) => [min(a, p[j]), max(b, p[j])], [Infinity, -Infinity]), sound = x => x != null && isFinite(x);
function graph() {
  const x = input(), y = quantities()[quantity], right = plot.clientWidth - 18, high = plot.clientHeight;
  if (!y || !high) return;
  plot.replaceChildren(); give(plot, { viewBox: `0 0 ${right + 18} ${high}` });
  const values = [], told = [];
  for (let i = 0; i < D.poses; i++) if (D.status[i] !== "waiting") {
    const v = !D.status[i] && sound(y.at(i)) ? [x.at(i), y.at(i)] : null;
    values.push(v); if (v) told.push(v);
  }
  if (!told.length) { series = null; write(plot, 10, 24, "Known of the given motion only.", "start"); $("reading").textContent = "–"; return; }
  const [[x0, x1], [y0, y1]] = [0, 1].map(j => { const [a, b] = extent(told, j), spare = b - a > 1e-12 * (abs(a) + abs(b)) ? 0 : abs(a) * 0.1 || 1; return [a - spare, b + spare]; });
  const pad = 0.05 * (y1 - y0), left = 54, low = high - 34;
  const px = v => left + (v - x0) / (x1 - x0) * (right - left), py = v => low - (v - y0 + pad) / (y1 - y0 + 2 * pad) * (low - 10);
  // An axis has some numbers, and angles in radians are read in parts of π.
  const turns = x.unit === "rad" ? PI : 1, [xs, xd] = ticks(x0 / turns, x1 / turns, max(4, (right + 18) / 90)), [ys, yd] = ticks(y0 - pad, y1 + pad, 6);
  for (const v of xs) { const at = px(v * turns); line(plot, "rule", at, 10, at, low); write(plot, at, low + 13, minus(v.toFixed(xd)) + (turns > 1 && v ? "π" : ""), "middle"); }
  for (const v of ys) { const at = py(v); line(plot, "rule", left, at, right, at); write(plot, left - 5, at + 3.5, minus(yd > 4 || abs(v) >= 1e5 ? v.toPrecision(3) : v.toFixed(yd)), "end"); }
  write(plot, right, high - 5, x.text + within(x.unit), "end");
  make("path", { d: curve(values.map(v => v && [px(v[0]), py(v[1])])), class: "curve" }, plot);
  series = { x, y, px, py };
  cursors = [line(plot, "cursor", 0, 10, 0, low), make("circle", { r: 3.5, class: "dot" }, plot)];
  cursor();
}
function cursor() {
  if (!series) return;
  const a = series.x.at(k), b = series.y.at(k), known = sound(a) && sound(b);
  for (const node of cursors) seen(node, known);
  $("reading").textContent = known ? minus(abs(b) >= 1e5 ? b.toExponential(3) : b.toPrecision(5)) + (series.y.unit === "°" ? "°" : series.y.unit && " " + series.y.unit) : "–";
  if (known) { give(cursors[0], { transform: `translate(${series.px(a)})` }); give(cursors[1], { cx: series.px(a), cy: series.py(b) }); }
}
function charts() {
  $("graph").hidden = last < 1;
  if (last < 1) return;
  const list = $("quantity");
  quantities().forEach((q, i) => list.append(el("option", { value: i }, q.text)));
  list.value = quantity;
  on(list, "change", () => { quantity = +list.value; graph(); });
  on(plot, "pointerdown pointermove", event => {
    if (!series || !event.buttons && event.type === "pointermove") return;
    const at = event.clientX - plot.getBoundingClientRect().left;
    let best = nearest, least = Infinity;
    for (let i = 0; i < D.poses; i++) { const gap = abs(series.px(series.x.at(i)) - at); if (gap < least) { least = gap; best = i; } }
    pause(); show(best);
  });
  new ResizeObserver(graph).observe(plot);
  graph();
}
$("degrees").checked = degrees;
on($("degrees"), "change", () => { degrees = $("degrees").checked; show(k); graph(); });
$("degrees").parentNode.hidden = !D.scalars.some(s => s.angle);

const save = (name, kind, text) => {
  const link = el("a", { download: name, href: text.startsWith("data:") ? text : URL.createObjectURL(new Blob([text], { type: kind })) });
  $("csv").after(link); link.click(); link.remove();  // in the document, where VS Code sees it and asks where to
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
};
const file = (D.title.replace(/[^\w-]+/g, "-").replace(/^-+|-+$/g, "") || "mechanism").slice(0, 60);
function tableText() {
  handled?.whole();
  const places = D.points.flatMap(p => axes.map(a => p.name + "." + a));  // columns of their own, driven or not
  const shown = rows.scalars.map(x => x[1]).filter(s => s.values.length >= D.poses && !places.includes(s.name || s.symbol)), head = (name, unit) => { const t = name + within(unit); return /[\x22,]/.test(t) ? "\x22" + t.replace(/\x22/g, "\x22\x22") + "\x22" : t; };
  const text = (v, good) => good && v != null ? +v.toPrecision(12) : "";
  const lines = [["pose", ...shown.map(s => head(s.name || s.symbol, unitOf(s))), ...places.map(name => head(name, D.unit))]];
  const asked = name => D.scalars.find(s => s.driven && (s.name || s.symbol) === name)?.values;
  for (let i = 0; i < D.poses; i++) lines.push([i, ...shown.map(s => text(s.values[i] && s.values[i] * angular(s), !D.status[i] || s.driven)), ...D.points.flatMap(p => axes.map(a => { const given = D.status[i] && asked(p.name + "." + a); return text((given || p[a])[i], given || !D.status[i] || !p.moves); }))]);
  return lines.join("\n") + "\n";
}
function pictureText() {
  const drawn = $("drawing"), copied = drawn.cloneNode(true), from = drawn.querySelectorAll("*"), to = copied.querySelectorAll("*");
  const kept = "fill fill-opacity stroke stroke-width stroke-opacity stroke-dasharray stroke-linejoin stroke-linecap font-size font-style font-family text-anchor dominant-baseline paint-order visibility opacity".split(" ");
  to.forEach((node, i) => { const style = getComputedStyle(from[i]); node.style.cssText = kept.map(name => `${name}:${style.getPropertyValue(name)}`).join(";"); });
  for (const node of copied.querySelectorAll(".grip")) node.remove();
  give(copied, { xmlns: space });
  return new XMLSerializer().serializeToString(copied);
}
on($("csv"), "click", () => save(file + ".csv", "text/csv", tableText()));
on($("picture"), "click", () => D.dim === 2 ? save(file + ".svg", "image/svg+xml", pictureText()) : save(file + ".png", "image/png", $("drawing").toDataURL("image/png")));
