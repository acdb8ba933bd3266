// A changed design is drawn as it stands, or if turns count, where no angle has made half a one: a drawing does not tell.
const drawing = () => {
  const q = now.q.slice(), good = to => S.follow(q, now.c, to) && L.counted.every(i => abs(q[i]) < PI - 1e-6);
  return [L.driven.map(i => q[i]), ...[L.home, ...L.asked].map(to => to.map(wrapped))].some(good) && q;
};
// A joint gets as near as it can by steps of Levenberg and Marquardt: at full reach all inputs move it the same way.
function pull(column, wanted) {
  const off = () => less(wanted, placeIn(now.q, column));
  let good = true;
  for (let turn = 0, damping = 1; turn < 16; turn++) {
    const before = now.q.slice(), gap = hypot(...off()), to = toward(column, off(), damping * gap / L.length + 1e-9);
    if (!to) break;
    good = led(to);
    const gain = gap - hypot(...off());
    if (gain > 0) damping /= 4; else { now.q.set(before); damping *= 8; }
    if (abs(gain) < 1e-7 * L.length) break;
  }
  tell(good);
}
function toward(column, [f, g], damping) {
  const q = now.q, slopes = S.slopes(q, now.c);
  if (!slopes) return null;
  const ways = L.driven.map((k, i) => {
    const p = q.slice();
    p[k]++;
    L.unknown.forEach((u, j) => { p[u] += slopes[j * L.driven.length + i] / L.weights[j]; });
    return less(placeIn(p, column), placeIn(q, column));  // it is linear
  });
  // Inputs count by how far they move the joint, none by rounding: beside its dead point one leaves the others their part.
  const shares = ways.map(([x, y]) => (x = x * x + y * y) > 1e-12 * L.length ** 2 ? 1 / x : 0);
  const [a, b, c] = ways.reduce(([a, b, c], [x, y], i) => [a + x * x * shares[i], b + x * y * shares[i], c + y * y * shares[i]], [damping, 0, damping]);
  const steps = ways.map(([x, y], i) => (x * (c * f - b * g) + y * (a * g - b * f)) / (a * c - b * b) * shares[i]);
  const most = max(...steps.map((x, i) => abs(x) / (L.angles[i] ? 0.5 : 0.3 * L.length)), 1);
  return steps.map((x, i) => q[L.driven[i]] + x / most);
}
function reshape(column, wanted, again) {
  const q = now.q.slice(), m = markersAt(q).slice(), [marker, i] = sources[column];
  wanted.forEach((x, axis) => { if (marker) m[i + axis] = x; else if (!L.fixed[i + axis] || L.fixed[i + 1 - axis]) q[i + axis] = x; });
  let next = read(q, now.d, m);
  next = read(q, next.d, m);
  const moved = S.correct(q, next.c);
  // Where it cannot be, as beside its guide: as near as it gets along the way that it takes.
  const place = placeIn(q, column), way = less(place, placeIn(now.q, column)), off = less(wanted, place);
  const share = (off[0] * way[0] + off[1] * way[1]) / hypot(...way) ** 2;
  if (!again && !marker && abs(share) > 1e-9) return reshape(column, place.map((x, axis) => x + way[axis] * share), true);
  if (!(moved <= 0.1 * L.length)) return say(D.sentences.stays);
  if (moved > 1e-9 * L.length) { const kept = next.d; next = { ...read(q, kept, m), d: kept }; S.correct(q, next.c); }
  Object.assign(now, next);
  changed();
}
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
    if (high < low) continue;
    longer = true;
    const [start, end] = item.vertices || [item.start, item.end];
    start[0] = low; end[0] = high;
  }
  k = pose;
  if (longer) show(k);
}
// The view again, where the mechanism has left the picture, or become as small in it as `least`. Not from under a
// pointer that holds a joint or may take the next: when it has gone, a finger where it is lifted.
function fit(least) {
  if (rings.some(node => node.onpointermove)) return;
  const [[x0, y0], [x1, y1]] = D.box, there = everywhere();
  const [[a, b], [c, d]] = [0, 1].map(i => extent(there, i)), out = min(X(a), width - X(b), Y(d), height - Y(c)) < 0;
  if (out || hypot(b - a, d - c) < least * hypot(x1 - x0, y1 - y0)) { D.box.splice(0, 2, [a, c], [b, d]); layout(); }
}
const mode = on => { shaping = on; give($("move"), { "aria-pressed": !on }); give($("shape"), { "aria-pressed": on }); grips(); };
on($("move"), "click", () => mode(false));
on($("shape"), "click", () => mode(true));
// Round the joints, where a finger or the arrow keys take hold of them. They stay for as long as the page does, whatever is
// drawn anew: an element that is taken away loses the pointer and the focus.
const rim = make("g", {}, svg), rings = D.points.map((p, column) => {
  const node = make("circle", { r: 15, class: "grip", tabindex: 0, "aria-label": `${p.name}: drag, or move with the arrow keys`, role: "button" }, rim);
  const go = to => { (shaping ? reshape : pull)(column, world(to)); }, begin = () => { take(); if (shaping) remember(); };
  let waiting = null;
  on(node, "pointerdown", event => {
    if (node.onpointermove) return;  // another finger
    event.preventDefault(); pause(); node.setPointerCapture(event.pointerId); node.focus({ preventScroll: true });
    begin();
    const shift = less(at(column), spot(event));
    node.onpointermove = event => {
      if (!waiting) raf(() => { const to = waiting; waiting = null; go(to); });
      waiting = spot(event).map((x, i) => x + shift[i]);
    };
  });
  on(node, "lostpointercapture", () => { node.onpointermove = null; });
  on(node, "keydown", event => {
    const way = ways[event.key];
    if (!way || chorded(event)) return;
    event.preventDefault(); event.stopPropagation(); begin();
    go(at(column).map((x, i) => x + (event.shiftKey ? 24 : 6) * way[i])); fit(0);
  });
  return node;
});
on(svg, "pointerleave", () => raf(() => fit(0)));
// A finger on a joint does not scroll the page.
on(rim, "touchstart", event => event.preventDefault(), { passive: false });
function grips() {
  rings.forEach((node, column) => {
    const p = D.points[column], [cx, cy] = at(column);
    seen(node, p.moves || shaping);
    if (p.x[k] != null) give(node, { cx, cy });
  });
}
