// Centres of mass go with their bodies into a saved design.
L.design.centres.forEach(([a, b, foot, x, y], i) => {
  const p = j => q.slice(2 * j, 2 * j + 2), [dx, dy] = less(p(b), p(a)), size = hypot(dx, dy), [fx, fy] = p(foot), [one, two] = L.design.centred[i];
  set(one, exact(fx + (x * dx - y * dy) / size)); set(two, exact(fy + (x * dy + y * dx) / size));
});
