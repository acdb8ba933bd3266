// From one assembly to the next at the inputs that are shown: all follow from those found when the page was made.
const next = el("button", { id: "assembly", type: "button", title: "The next assembly at these inputs" });
let assemblies = [], resting = 0, chosen = false;
const same = (p, q) => p.every((x, i) => i >= first || abs(x - q[i]) < 1e-5 * L.length);
// A pose of numbers c is led to the inputs and numbers that are shown, angles in the turn in which they stand.
function lead(p, c) {
  if (!(S.correct(p, c) >= 0 && S.follow(p, c, L.driven.map((at, i) => p[at] + wrapped(now.q[at] - p[at], i))))) return false;
  D.scalars.forEach((s, i) => { if (s.angle) p[first + i] += turn * round((now.q[first + i] - p[first + i]) / turn); });
  L.driven.forEach(at => { p[at] = now.q[at]; });
  return !designed || S.morph(p, c, now.c, now.q) === 1;
}
// Those that are known keep their order, new ones come after them. How many stand before the one that is shown.
function gather() {
  const far = set => hypot(...set.asked.map((x, i) => wrapped(now.q[L.driven[i]] - x, i)));
  const starts = assemblies.map(p => [p, now.c.slice()]);
  for (const set of [...L.assemblies].sort((a, b) => far(a) - far(b)).slice(0, 2)) for (const unknown of set.q) {
    const p = Float64Array.from(L.q);
    L.driven.forEach((at, i) => { p[at] = set.asked[i]; });
    L.unknown.forEach((at, i) => { p[at] = unknown[i]; });
    starts.push([p, original.c.slice()]);
  }
  assemblies = [];
  for (const [p, c] of [...starts, [now.q.slice(), now.c.slice()]]) if (lead(p, c) && !assemblies.some(q => same(p, q))) assemblies.push(p);
  const here = assemblies.findIndex(p => same(p, now.q));
  next.textContent = `assembly ${here + 1} of ${assemblies.length}`;
  next.disabled = assemblies.length < 2;
  return here;
}
// What the button says is found out when nothing has moved for a while, and then the view takes in what was chosen.
function settle() {
  if (job) return rest();
  if (D.status[k] === 0) { take(); gather(); } else next.disabled = true;
  if (chosen) fit(0);
  chosen = false;
}
rest = () => { clearTimeout(resting); resting = setTimeout(settle, 150); };
on(next, "click", () => {
  pause(); take();
  const here = gather();
  if (assemblies.length < 2) return;
  remember();
  now.q.set(assemblies[(here + 1) % assemblies.length]);
  chosen = true;
  changed(); gather();
});
until.signal.addEventListener("abort", () => clearTimeout(resting));
$("viewing").append(next);
