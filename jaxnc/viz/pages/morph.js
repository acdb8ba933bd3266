// Of the solver, what mechanisms need to be changed.
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
