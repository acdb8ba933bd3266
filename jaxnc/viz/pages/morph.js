// Of the solver, what mechanisms need to be dragged and changed.
// Numbers c0 become c1, and coordinates that are not solved for those of goal; q and c stay where they can. How far.
const morph = (q, c, c1, goal) => {
  const c0 = c.slice(), q0 = q.slice(), solved = new Set(L.unknown);
  residual(q, c);
  let here = look(q, c, false, R), done = 0, part = 1;
  while (done < 1) {
    part = min(part, 1 - done);
    const to = done + part > 1 - 1e-12 ? 1 : done + part, p = q.slice(), d = c0.map((x, i) => x + (c1[i] - x) * to);
    for (let i = 0; i < p.length; i++) if (!solved.has(i)) p[i] = q0[i] + (goal[i] - q0[i]) * to;
    const moved = correct(p, d, 10);
    let there = null;
    if (moved <= 0.1 * L.length && upright(p, d)) there = look(p, d, false, R);
    if (there && here && n === m && there.sign !== here.sign) there = null;
    if (there) { q.set(p); c.set(d); here = there; done = to; part *= 2; } else part /= 2;
    if (!there && part < 1e-3) break;
  }
  return done;
};
// The inputs that bring a place near to where it is wanted: a share of one step of Gauss and Newton, not too long.
const toward = (q, c, place, wanted, share) => {
  residual(q, c);
  const found = look(q, c, true, R);
  if (!found) return null;
  const at = place(q), h = 1e-6, slopes = L.driven.map((k, i) => {
    const p = q.slice();
    p[k] += h;
    each((u, j) => { p[u] += h * found.T[j * driven + i] / L.weights[j]; });
    return place(p).map((x, axis) => (x - at[axis]) / h);
  });
  // Least squares, a little damped: as many inputs as there are, two axes. Each counts by how far it moves the place,
  // so that one beside its dead point, where that is without end, leaves the others their part.
  const spans = slopes.map(s => hypot(...s) || 1), ways = slopes.map((s, i) => s.map(v => v / spans[i]));
  const [g, h2] = wanted.map((x, axis) => x - at[axis]), sum = f => ways.reduce((all, s) => all + f(s), 0);
  const a = sum(s => s[0] * s[0]) + 1e-9, d = sum(s => s[1] * s[1]) + 1e-9, o = sum(s => s[0] * s[1]), det = a * d - o * o;
  const x = ways.map((s, i) => (s[0] * (d * g - o * h2) + s[1] * (a * h2 - o * g)) / det / spans[i]);
  const most = max(...x.map((y, k) => abs(y) / (L.angles[k] ? 0.5 : 0.3 * L.length)), 1);
  return x.map((y, i) => q[L.driven[i]] + share * y / most);
};
const changing = { morph, toward };
