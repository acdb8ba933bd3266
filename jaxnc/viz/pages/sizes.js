// Dimensions are changed.
// What a drawing says: numbers, angles and distances, markers' coefficients, lengths that are given.
function read(q, d, m = markersAt(now.q)) {
  const c = now.c.slice(), s = zeros(D.scalars.length), k = now.k.slice(), e = d.slice();
  F.design(q, m, d, c, s, k, e);
  q.set(s, first);
  return { q, c, k, d: e };
}
const changed = (failed = "") => { designed = true; present(); redraw(); say(failed); };
// Other numbers for the same drawing: the mechanism is led there as far as it can be assembled.
function change(c, d, what) {
  const before = now.d, done = S.morph(now.q, now.c, c, now.q);
  now.d = before.map((x, i) => x + (d[i] - x) * done);
  changed(done > 1 - 1e-9 ? "" : what + D.sentences.stuck);
}
function setDimension(i, value) {
  const d = now.d.slice();
  d[i] = value;
  change(read(now.q.slice(), d).c, d, L.dimensions[i].name);
}
function setLink({ points: [a, b], numbers }, value, old, name) {
  const q = now.q.slice(), c = now.c.slice();
  for (let i = 0; i < dim; i++) q[dim * b + i] = q[dim * a + i] + (q[dim * b + i] - q[dim * a + i]) * value / old;
  const found = read(q, now.d).c;
  for (const k of numbers) c[k] = found[k];
  change(c, now.d, name);
}
const resized = (name, unit, positive, value, set) => {
  const c = control("sizes", name, unit), x = value(), spread = abs(x) || 0.3 * L.length;
  c.slide.min = positive ? 0.3 * x : x - spread; c.slide.max = positive ? 2 * x : x + spread;
  let held;
  c.heard(v => { pause(); if (positive && v <= 1e-9 * L.length) return sizes(); if (!held) remember(); held = true; take(); set(v); }, () => { held = false; fit(0.6); });
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
on(undo, "click", () => { if (past.length) back(past.pop()); });
on($("reset"), "click", () => { past.length = 0; back(original); });
// The changed design: a model file, or values by name.
on($("design"), "click", () => {
  take();
  const q = drawing();
  if (!q) return say(D.sentences.home);
  const d = now.d.slice(), out = structuredClone(L.design.file), exact = x => +x.toPrecision(15);
  const set = (path, value) => { if (path?.length) path.slice(0, -1).reduce((to, key) => to[key] ??= {}, out)[path.at(-1)] = value; };
  const places = (paths, from) => paths.forEach((path, i) => set(path, [...from.slice(dim * i, dim * i + dim)].map(exact)));
  places(L.design.points, q); places(L.design.markers, markersAt(q));
  F.saved?.(q, now.c, d);
  L.design.dimensions.forEach((path, i) => set(path, exact(d[i])));
  {{CENTRES}}
  save(file + ".json", "application/json", JSON.stringify(out, null, 1) + "\n");
});
