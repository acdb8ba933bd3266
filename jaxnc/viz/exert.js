// Forces in a pose that was found here: multipliers that balance it, and what follows from them.
// Where dynamics has coordinates that are not solved for, its rows are others.
const I = L.inner, felt = new Float64Array(L.felt), pushes = new Float64Array((I || L).unknown.length);
const holder = I ? solver({ matrix: (q, given, o) => F.inner(...given, null, o), driven: () => {} }, I) : S;
exert = (pose, q) => {
  const all = ratesOf(pose, q), given = [q, markersAt(q), now.d, now.c, ...all, D.time ? D.time[pose === T ? nearest : pose] : 0];
  F.pushes(...given, null, pushes);
  const held = holder.held(q, I ? given : now.c, pushes);
  if (held) F.forces(...given, held, felt);
  let i = 0;
  const next = () => held ? felt[i++] : null, vector = () => axes.map(next), put = (to, from) => axes.forEach((axis, j) => { to[axis][pose] = from[j]; });
  const arrow = scale => held ? cut(vector(), scale) : axes.map(next);
  for (const set of D.arrows) set.feet?.forEach((foot, n) => { if (foot.x) put(foot, vector()); set.vectors[n][pose] = arrow(set.scale); });
  for (const [foot, tip, scale] of D.pressing || []) { const p = vector(), f = arrow(scale); put(D.tips[foot], p); put(D.tips[tip], p.map((x, j) => held ? x + f[j] : null)); }
  for (const s of D.series) if (s.made) s.values[pose] = next();
};
