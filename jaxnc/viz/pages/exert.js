// Forces in a pose that was found here: multipliers that balance it, and what follows from them.
// Where dynamics has coordinates that are not solved for, its rows are others.
const I = L.inner, felt = zeros(L.felt), pushes = zeros((I || L).unknown.length), holds = [];
const holder = I ? solver({ matrix: (q, given, o) => F.inner(...given, null, o), driven: () => {} }, I) : S;
loose = pose => holds[pose] === false;
exert = (pose, q) => {
  const all = ratesOf(pose, q), given = all && [q, markersAt(q), now.d, now.c, ...all, D.time ? D.time[pose === T ? nearest : pose] : 0];
  if (given) F.pushes(...given, null, pushes);
  const held = given && !(dim > 2 && designed) && holder.held(q, I ? given : now.c, pushes);
  holds[pose] = !!held;
  if (held) F.forces(...given, held, felt); else felt.fill(0);
  let i = 0;
  const next = () => felt[i++], vector = () => axes.map(next);
  for (const set of D.arrows) if (set.order > 1) for (const shaft of set.shafts) {
    if (shaft[0] >= sources.length) put(shaft[0], pose, vector());
    point(pose, shaft, vector(), set.scale);
  }
  for (const s of D.series) if (s.made) s.values[pose] = held ? next() : null;
};
