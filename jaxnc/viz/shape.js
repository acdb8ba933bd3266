// In the plane joints are dragged, and dimensions changed.
function pull(column, wanted) {
  const place = q => placeIn(q, column);
  let good = true;
  for (let turn = 0; turn < 5 && good; turn++) {
    const to = S.toward(now.q, now.c, place, wanted);
    if (!to) break;
    const before = now.q.slice();
    good = led(to);
    if (largest(before.map((x, i) => x - now.q[i])) < 1e-7 * L.length) break;
  }
  tell(good);
}
// What a drawing says: numbers, angles and distances, markers' coefficients, lengths that are given.
function read(q, m, d) {
  const c = now.c.slice(), s = zeros(D.scalars.length), k = now.k.slice(), e = d.slice();
  F.design(q, m, d, c, s, k, e);
  q.set(s, first);
  return { q, c, k, d: e };
}
const changed = (failed = "") => { present(); redraw(); say(failed); };
function reshape(column, wanted) {
  const q = now.q.slice(), m = markersAt(q).slice(), [marker, i] = sources[column];
  wanted.forEach((x, axis) => { if (marker) m[i + axis] = x; else if (!L.fixed[i + axis] || L.fixed[i + 1 - axis]) q[i + axis] = x; });
  let next = read(q, m, now.d);
  next = read(q, m, next.d);
  const moved = S.correct(q, next.c);
  if (!(moved <= 0.1 * L.length)) return say("So it cannot be assembled: it stays as it was.");
  if (moved > 1e-9 * L.length) { const kept = next.d; next = { ...read(q, m, kept), d: kept }; S.correct(q, next.c); }
  Object.assign(now, next);
  changed();
}
// Other numbers for the same drawing: the mechanism is led there as far as it can be assembled.
function change(c, d, what) {
  const before = now.d, done = S.morph(now.q, now.c, c, now.q);
  now.d = before.map((x, i) => x + (d[i] - x) * done);
  changed(done > 1 - 1e-9 ? "" : `${what} goes no further: the mechanism could not be assembled.`);
}
function setDimension(i, value) {
  const d = now.d.slice();
  d[i] = value;
  change(read(now.q.slice(), markersAt(now.q).slice(), d).c, d, L.dimensions[i].name);
}
function setLink({ points: [a, b], numbers }, value, old, name) {
  const q = now.q.slice(), c = now.c.slice();
  for (const axis of [0, 1]) q[2 * b + axis] = q[2 * a + axis] + (q[2 * b + axis] - q[2 * a + axis]) * value / old;
  const found = read(q, markersAt(now.q).slice(), now.d).c;
  for (const k of numbers) c[k] = found[k];
  change(c, now.d, name);
}
const resized = (name, unit, positive, value, set) => {
  const c = control("sizes", name, unit), x = value(), spread = abs(x) || 0.3 * L.length;
  c.slide.min = positive ? 0.3 * x : x - spread; c.slide.max = positive ? 2 * x : x + spread;
  let held = false;
  const go = v => { pause(); if (!isFinite(v) || positive && !(v > 0)) return sizes(); if (!held) remember(); held = true; take(); set(v); }, done = () => { held = false; fit(); };
  on(c.slide, "input", () => go(Number(c.slide.value)));
  on(c.slide, "change pointerup blur", done);
  on(c.field, "change", () => { held = false; go(Number(c.field.value)); done(); });
  return () => c.fill(value());
};
const sized = [
  ...L.dimensions.map((x, i) => resized(x.name, x.unit, x.positive, () => now.d[i], v => setDimension(i, v))),
  ...L.links.map(link => {
    const name = link.points.map(p => L.points[p]).join("–"), value = () => hypot(...less(...link.points.map(p => placeIn(now.q, p))));
    return resized(name, D.unit, true, value, v => setLink(link, v, value(), name));
  }),
];
function sizes() { for (const update of sized) update(); }
// Guides and slots as long as what slides along them needs.
function stretch() {
  const pose = k;
  let longer = false;
  for (const item of D.items) {
    let low = Infinity, high = -Infinity;
    for (const [p, spare] of item.reach || []) for (k = 0; k < T; k++) if (D.status[k] === 0) {
      const [o, e] = stand(item.frame), x = less(at(p), o), s = (x[0] * e[0] + x[1] * e[1]) / scale;
      low = min(low, s - spare); high = max(high, s + spare);
    }
    if (!(high >= low)) continue;
    longer = true;
    const [start, end] = item.vertices || [item.start, item.end];
    start[0] = low; end[0] = high;
  }
  k = pose;
  if (longer) layout();
}
// The view again, where a changed mechanism has left it or become small in it.
function fit() {
  if (!designed) return;
  const there = [], [[x0, y0], [x1, y1]] = D.box, size = hypot(x1 - x0, y1 - y0);
  for (const p of D.points) for (let pose = 0; pose <= T; pose++) if (D.status[pose] === 0 && p.x[pose] != null) there.push([p.x[pose], p.y[pose]]);
  const [[a, b], [c, d]] = [extent(there, 0), extent(there, 1)], out = max(x0 - a, y0 - c, b - x1, d - y1);
  if (isFinite(out) && (out > 0.03 * size || hypot(b - a, d - c) < 0.6 * size)) { D.box.splice(0, 2, [a, c], [b, d]); layout(); }
}
const mode = on => { shaping = on; give($("move"), { "aria-pressed": !on }); give($("shape"), { "aria-pressed": on }); grips(); };
on($("move"), "click", () => mode(false));
on($("shape"), "click", () => mode(true));
on(undo, "click", () => { if (past.length) back(past.pop()); });
on($("reset"), "click", () => { past.length = 0; back(original); });
// Round the joints, where a finger or the arrow keys take hold of them; the drawing calls this when it is laid out.
function grips() {
  for (const node of svg.querySelectorAll(".grip")) node.remove();
  moving = moving.filter(update => !update.grip);
  D.points.forEach((p, column) => {
    if (!p.moves && !shaping) return;
    const node = make("circle", { r: 15, class: "grip", tabindex: 0, "aria-label": `${p.name}: drag, or move with the arrow keys`, role: "button" }, svg);
    const update = () => { const [cx, cy] = at(column); if (isFinite(cx)) give(node, { cx, cy }); };
    update.grip = true; move(update);
    const go = to => { (shaping ? reshape : pull)(column, world(to)); }, begin = () => { take(); if (shaping) remember(); };
    let waiting = null;
    on(node, "pointerdown", event => {
      event.preventDefault(); pause(); node.setPointerCapture(event.pointerId); node.focus({ preventScroll: true });
      begin();
      shift = less(at(column), spot(event));
      node.onpointermove = event => {
        if (!waiting) raf(() => { const to = waiting; waiting = null; go(to); });
        waiting = spot(event).map((x, i) => x + shift[i]);
      };
      node.onpointerup = node.onpointercancel = () => { node.onpointermove = node.onpointerup = node.onpointercancel = null; raf(fit); };
    });
    on(node, "keydown", event => {
      const way = ways[event.key];
      if (!way) return;
      event.preventDefault(); event.stopPropagation(); begin();
      go(at(column).map((x, i) => x + (event.shiftKey ? 24 : 6) * way[i]));
    });
  });
}
// The changed design: a model file, or values by name.
$("design").hidden = false;
$("design").textContent = "name" in L.design.file ? "model file" : "design";
on($("design"), "click", () => {
  take();
  const out = structuredClone(L.design.file), at = markersAt(now.q), exact = x => Number(x.toPrecision(15));
  const set = (path, value) => { if (!path || !path.length) return; let to = out; for (const key of path.slice(0, -1)) to = to[key] ??= {}; to[path[path.length - 1]] = value; };
  const pairs = (paths, from) => paths.forEach((path, i) => set(path, [exact(from[2 * i]), exact(from[2 * i + 1])]));
  pairs(L.design.points, now.q); pairs(L.design.markers, at);
  L.design.dimensions.forEach((path, i) => set(path, exact(now.d[i])));
  {{CENTRES}}
  save(file + ".json", "application/json", JSON.stringify(out, null, 1) + "\n");
});
