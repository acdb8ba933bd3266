// In the plane joints are dragged, and dimensions changed.
function pull(column, wanted) {
  const place = placeOf(column);
  let good = true;
  for (let turn = 0; turn < 5 && good; turn++) {
    const to = S.toward(now.q, now.c, place, wanted);
    if (!to) break;
    const before = now.q.slice();
    good = S.follow(now.q, now.c, to);
    if (max(...before.map((x, i) => abs(x - now.q[i]))) < 1e-7 * L.length) break;
  }
  present();
  say(good ? "" : deadPoint());
}
// What a drawing says: numbers, angles and distances, markers' coefficients, lengths that are given.
function read(q, m, d) {
  const c = now.c.slice(), s = new Float64Array(D.scalars.length), k = now.k.slice(), e = d.slice();
  F.design(q, m, d, c, s, k, e);
  q.set(s, first);
  return { q, c, k, d: e };
}
function reshape(column, wanted) {
  const q = now.q.slice(), m = markersAt(q).slice();
  if (column < places) wanted.forEach((x, axis) => { const i = 2 * column + axis; if (!L.fixed[i] || L.fixed[2 * column + 1 - axis]) q[i] = x; });
  else wanted.forEach((x, axis) => { m[2 * riding[column - places] + axis] = x; });
  let next = read(q, m, now.d);
  next = read(next.q, m, next.d);
  const moved = S.correct(next.q, next.c);
  if (!(moved <= 0.1 * L.length)) return say("So it cannot be assembled: it stays as it was.");
  if (moved > 1e-9 * L.length) { const kept = next.d; next = read(next.q, m, kept); next.d = kept; S.correct(next.q, next.c); }
  Object.assign(now, next);
  say(""); present(); redraw();
}
// Other numbers for the same drawing: the mechanism is led there as far as it can be assembled.
function change(c, d, what) {
  const before = now.d, done = S.morph(now.q, now.c, c, now.q);
  now.d = before.map((x, i) => x + (d[i] - x) * done);
  say(done > 1 - 1e-9 ? "" : `${what} goes no further: the mechanism could not be assembled.`);
  present(); redraw();
}
function setDimension(i, value) {
  take();
  const d = now.d.slice();
  d[i] = value;
  const c = read(now.q.slice(), markersAt(now.q).slice(), d).c;
  change(c, d, L.dimensions[i].name);
}
function setLink(link, value) {
  take();
  const q = now.q.slice(), [a, b] = link.points, old = reach(link);
  for (let axis = 0; axis < 2; axis++) q[2 * b + axis] = q[2 * a + axis] + (q[2 * b + axis] - q[2 * a + axis]) * value / old;
  const found = read(q, markersAt(now.q).slice(), now.d).c, c = now.c.slice();
  for (const k of link.numbers) c[k] = found[k];
  change(c, now.d, `${L.points[a]}–${L.points[b]}`);
}
const reach = link => hypot(...[0, 1].map(axis => now.q[2 * link.points[1] + axis] - now.q[2 * link.points[0] + axis]));

const sized = [
  ...L.dimensions.map((x, i) => ({ ...control($("sizes"), x.name, x.unit), value: () => now.d[i], set: v => setDimension(i, v), positive: x.positive })),
  ...L.links.map(link => ({ ...control($("sizes"), link.points.map(p => L.points[p]).join("–"), D.unit), value: () => reach(link), set: v => setLink(link, v), positive: true })),
];
for (const c of sized) {
  const x = c.value(), spread = abs(x) || 0.3 * L.length;
  c.slide.min = c.positive ? 0.3 * x : x - spread; c.slide.max = c.positive ? 2 * x : x + spread;
  let held = false;
  const set = v => { pause(); if (!isFinite(v) || c.positive && !(v > 0)) return sizes(); if (!held) remember(); held = true; c.set(v); };
  on(c.slide, "input", () => set(Number(c.slide.value)));
  for (const event of ["change", "pointerup", "blur"]) on(c.slide, event, () => { held = false; fit(); });
  on(c.field, "change", () => { held = false; set(Number(c.field.value)); held = false; fit(); });
}
function sizes() {
  for (const c of sized) {
    const x = c.value();
    if (idle(c.slide)) c.slide.value = x;
    if (idle(c.field)) c.field.value = Number(x.toPrecision(6));
  }
}
// The view again, where a changed mechanism has left it or become small in it.
function fit() {
  if (!designed) return;
  const x = [[], []], [[x0, y0], [x1, y1]] = D.box;
  for (const p of D.points) for (let pose = 0; pose <= T; pose++) if (p.x[pose] !== null && p.x[pose] !== undefined && D.status[pose] === 0) { x[0].push(p.x[pose]); x[1].push(p.y[pose]); }
  const low = x.map(v => v.reduce((a, b) => min(a, b), Infinity)), high = x.map(v => v.reduce((a, b) => max(a, b), -Infinity)), size = hypot(x1 - x0, y1 - y0);
  const out = max(x0 - low[0], y0 - low[1], high[0] - x1, high[1] - y1), small = hypot(high[0] - low[0], high[1] - low[1]) < 0.6 * size;
  if (isFinite(out) && (out > 0.03 * size || small)) { D.box.splice(0, 2, low, high); layout(); }
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
    const update = () => { const [x, y] = at(column); if (isFinite(x)) give(node, { cx: x, cy: y }); };
    update.grip = true; update(); moving.push(update);
    const go = (x, y) => { const wanted = [(x - left) / scale, (base - y) / scale]; if (shaping) reshape(column, wanted); else pull(column, wanted); };
    let waiting = null;
    const follow = event => {
      const box = svg.getBoundingClientRect(), idle = !waiting;
      waiting = [event.clientX - box.left + shift[0], event.clientY - box.top + shift[1]];
      if (idle) raf(() => { const to = waiting; waiting = null; if (to) go(...to); });
    };
    on(node, "pointerdown", event => {
      event.preventDefault(); pause(); take(); node.setPointerCapture(event.pointerId); node.focus({ preventScroll: true });
      if (shaping) remember();
      const box = svg.getBoundingClientRect(), [x, y] = at(column);
      shift = [x - (event.clientX - box.left), y - (event.clientY - box.top)];
      node.onpointermove = follow;
      node.onpointerup = node.onpointercancel = () => { node.onpointermove = node.onpointerup = node.onpointercancel = null; raf(fit); };
    });
    on(node, "keydown", event => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!way) return;
      event.preventDefault(); event.stopPropagation(); take();
      if (shaping) remember();
      const [x, y] = at(column), by = event.shiftKey ? 24 : 6;
      go(x + by * way[0], y + by * way[1]);
    });
  });
}
// The changed design: a model file, or values by name.
if (L.design) {
  $("design").hidden = false;
  $("design").textContent = "name" in L.design.file ? "model file" : "design";
  on($("design"), "click", () => {
    take();
    const out = structuredClone(L.design.file), at = markersAt(now.q), exact = x => Number(x.toPrecision(15));
    const set = (path, value) => { if (!path || !path.length) return; let to = out; for (const key of path.slice(0, -1)) to = to[key] ??= {}; to[path[path.length - 1]] = value; };
    L.design.points.forEach((path, i) => set(path, [exact(now.q[2 * i]), exact(now.q[2 * i + 1])]));
    L.design.markers.forEach((path, i) => set(path, [exact(at[2 * i]), exact(at[2 * i + 1])]));
    L.design.dimensions.forEach((path, i) => set(path, exact(now.d[i])));
    {{CENTRES}}
    save(file + ".json", "application/json", JSON.stringify(out, null, 1) + "\n");
  });
}
