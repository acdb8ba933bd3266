// Forces: those of the motion as it was given; those of other poses and dimensions where the page finds them.
let forced = true;
const known = () => handled?.exerts || k < D.poses && !handled?.altered(), acting = () => forced && known();
const note = el("span");
told = () => { note.textContent = known() ? "" : `(${D.unforced})`; };
$("forces").parentNode.append(note);
const feet = D.arrows.flatMap(set => set.feet || []).filter(foot => foot.x);
for (const foot of feet) for (const axis of axes) foot[axis] = unpacked(foot[axis]);
$("forces").parentNode.hidden = !D.arrows.some(set => set.feet || set[2]);
on($("forces"), "change", event => { forced = event.target.checked; show(k); });
// In the plane: arrows, and at the foot of a weight the centre of mass, a disc of which two quarters are full.
const keyed = nodes => moving.push(() => { for (const node of nodes) give(node, { visibility: acting() ? "visible" : "hidden" }); });
const addForces = (set, parent, arrow, pen) => set.feet.forEach((foot, i) => {
  const [line, head] = pen(), disc = make("path", {}, parent), full = make("path", {}, parent), r = 1.05 * u;
  disc.style.cssText = `fill:var(--paper);stroke:var(--ink);stroke-width:${0.2 * u}px`; full.style.fill = "var(--ink)";
  moving.push(() => {
    const [vx, vy] = acting() ? set.vectors[i][k] : [null], [x, y] = foot.x ? [X(foot.x[k]), Y(foot.y[k])] : at(foot);
    const [shaft, tip] = vx === null ? ["", ""] : arrow(x, y, vx * scale, -vy * scale), heavy = vx !== null && set.noun === "weight";
    give(line, { d: shaft }); give(head, { d: tip });
    give(disc, { d: heavy ? `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z` : "" });
    give(full, { d: heavy ? `M${x} ${y}v${-r}a${r} ${r} 0 0 1 ${r} ${r}ZM${x} ${y}v${r}a${r} ${r} 0 0 1 ${-r} ${-r}Z` : "" });
  });
});
