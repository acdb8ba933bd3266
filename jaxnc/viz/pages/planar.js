const svg = $("drawing"), plane = make("g", {}, svg);  // all but what is held
// State of the view: pixels per length, pixels per unit, and where the lower left corner is.
let u = 5, scale = 1, left = 0, base = 0, width = 0, height = 0, moving = [], mobile = make("g"), trails = mobile;
const move = update => { moving.push(update); update(); };
const X = x => left + x * scale, Y = y => base - y * scale;
const at = column => { const [x, y] = placed(column); return [X(x), Y(y)]; };
const less = (p, q) => [p[0] - q[0], p[1] - q[1]], over = (p, q) => p[0] * q[1] - p[1] * q[0], apart = (a, b) => hypot(...less(at(a), at(b)));
const unitVector = (a, b) => { const size = apart(a, b); return size > 0 ? less(at(b), at(a)).map(x => x / size) : [1, 0]; };
const stand = ({ at: origin, toward, angle }) => [at(origin), toward ? unitVector(...toward) : [cos(angle), -sin(angle)]];
// A place of the drawing that a pointer is at, and where it is in the mechanism.
const spot = event => { const box = svg.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; }, world = ([x, y]) => [(x - left) / scale, (base - y) / scale];
// A place in a frame, pixels: along its direction, and across to its left.
const inFrame = ([o, e], along, across) => [o[0] + along * e[0] + across * e[1], o[1] + along * e[1] - across * e[0]];
const join = (points, closed) => curve(points) + (closed ? "Z" : "");
const shapes = {
  line: item => join(item.points.map(at), item.closed),
  stamp: item => { const f = stand(item.frame), size = item.ends ? apart(...item.ends) : scale; return join(item.vertices.map(v => inFrame(f, v[0] * size + v[1] * u, v[2] * u)), item.closed); },
  circle: item => {
    const [x, y] = at(item.at), length = item.span ? apart(...item.span) : (handled && item.number >= 0 ? abs(handled.now.c[item.number]) : item.radius) * scale;
    const r = length + item.units * u;
    return `M${x - r} ${y}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
  },
  casing: item => {
    const [a, b] = item.points.map(at), d = less(b, a), size = hypot(...d), clear = D.joint * u;
    let text = "";
    for (const pair of item.over) {
      const [p, q] = pair.map(at), w = less(p, a), f = less(q, p), other = hypot(...f), cross = over(d, f);
      const sine = abs(cross) / (size * other), s = over(w, f) / cross, t = over(w, d) / cross;
      const rest = min(s, 1 - s) * size, half = min(D.crossing * u / sine, rest - 0.5 * clear) / size;
      if (sine > D.shallow && rest > clear && min(t, 1 - t) * other > clear) text += join([s - half, s + half].map(x => [a[0] + x * d[0], a[1] + x * d[1]]));
    }
    return text;
  },
  hatch: item => {
    const f = stand(item.frame), [lo, hi] = [item.start, item.end].map(([length, units]) => length * scale + units * u);
    const count = max(2, round((hi - lo) / (0.85 * u)));
    let d = "";
    for (let i = 0; i < count; i++) {
      const s = lo + (hi - lo) * (i + 0.75) / count;
      d += join([inFrame(f, s, item.offset * u), inFrame(f, s - 0.75 * u, (item.offset + 0.95 * item.side) * u)]);
    }
    return d;
  },
};
const angleOf = ends => { const [x, y] = ends ? unitVector(...ends) : [1, 0]; return atan2(-y, x); };
const polar = ([x, y], radius, angle) => [x + radius * cos(angle), y - radius * sin(angle)];

function addItem(item, parent) {
  const look = D.styles[item.role].css.replaceAll("#", item.body < 0 ? "ink" : item.body % 10), node = make("path", { style: look }, parent);
  if (item.shape !== "arc") return move(() => give(node, { d: shapes[item.shape](item) }));
  const head = make("path", { class: "soft" }, parent), text = make("text", { class: "name soft" }, parent, item.text);
  move(() => {
    const centre = at(item.at), first = angleOf(item.start), extent = swept(angleOf(item.to) - first, item.low);
    const tip = sign(extent) * 1.5 / item.units, r = item.units * u, points = [], long = abs(extent) > abs(tip), end = first + extent;
    for (let i = 0; i <= 40; i++) points.push(polar(centre, r, first + (long ? extent - 0.8 * tip : extent) * i / 40));
    give(node, { d: join(points) });
    give(head, { d: long ? join([polar(centre, r, end), polar(centre, r - 0.5 * u, end - tip), polar(centre, r + 0.5 * u, end - tip)], true) : "" });
    const [x, y] = polar(centre, item.beside * u, first + item.share * extent + item.lead);
    give(text, { x, y });
  });
}
function addLabel(item) {
  const text = make("text", { class: "name" }, mobile, item.text);
  move(() => { const [x, y] = at(item.at), [a, b] = at(item.to ?? item.at); give(text, { x: (x + a) / 2 + item.dx * u, y: (y + b) / 2 - item.dy * u }); });
}
// An arrow between two places on the screen: none, where they are as good as one.
const arrow = (noun, parent) => {
  const shaft = make("path", { class: "shaft", style: `stroke:var(--${noun})` }, parent), head = make("path", { style: `fill:var(--${noun})` }, parent);
  return (from, to) => {
    const d = less(to, from), size = hypot(...d), [x, y] = d.map(v => v * min(2 * u / size, 1)), [bx, by] = less(to, [x, y]), long = size > 0.3;
    give(shaft, { d: long ? join([from, [bx, by]]) : "" });
    give(head, { d: long ? join([to, [bx - 0.375 * y, by + 0.375 * x], [bx + 0.375 * y, by - 0.375 * x]], true) : "" });
  };
};
// Weights stand at centres of mass: a disc of which two quarters are full.
function addArrows(set, row) {
  const there = () => set.order < 2 || acting(), r = 1.05 * u, end = width - 14, begin = end - set.key * scale;
  for (const [foot, tip] of set.shafts) {
    const draw = arrow(set.noun, mobile), mass = set.noun === "weight" && make("g", { class: "mass" }, mobile);
    if (mass) { make("circle", { r }, mass); make("path", { d: `M0 ${-r}A${r} ${r} 0 0 1 ${r} 0H${-r}A${r} ${r} 0 0 0 0 ${r}Z` }, mass); }
    move(() => { const yes = there(), from = at(foot); draw(from, yes ? at(tip) : from); if (mass) { seen(mass, yes); if (yes) give(mass, { transform: `translate(${from})` }); } });
  }
  const draw = arrow(set.noun, plane), text = write(plane, begin - 8, row, set.text, "end");
  give(text, { class: "key", style: `fill:var(--${set.noun})` });
  move(() => { draw([begin, row], [there() ? end : begin, row]); seen(text, there()); });
}
// A grid with its numbers, and the names of the axes.
function addAxes() {
  const parent = make("g", { class: "axes" }, plane);
  const marks = (low, high, long) => { const [values, digits] = ticks(low, high, long / 80); return values.map(v => [v, minus(v.toFixed(digits))]); };
  for (const [v, text] of marks(-left / scale, (width - left) / scale, width)) {
    const x = X(v); line(parent, "rule", x, 0, x, height); if (x > 26 && x < width - 52) write(parent, x, height - 5, text, "middle");
  }
  for (const [v, text] of marks((base - height) / scale, base / scale, height)) {
    const y = Y(v); line(parent, "rule", 0, y, width, y); if (y > 28 && y < height - 22) write(parent, 4, y - 3, text, "start");
  }
  write(parent, width - 4, height - 5, "x" + within(D.unit), "end");
  write(parent, 4, 12, "y" + within(D.unit), "start");
}
function layout() {
  const box = svg.getBoundingClientRect();
  width = box.width; height = box.height;
  if (!width || !height) return;
  plane.replaceChildren(); moving = [];
  u = max(3.4, min(6, min(width, height) / 85));
  give(svg, { viewBox: `0 0 ${width} ${height}` }); svg.style.setProperty("--u", u + "px");
  const [[x0, y0], [x1, y1]] = D.box, pad = 14 * u, keys = D.arrows.filter(set => set.key), above = handled ? 38 : 0, head = above + 18 * keys.length;
  const fit = min(x1 > x0 ? (width - pad) / (x1 - x0) : Infinity, y1 > y0 ? (height - head - pad) / (y1 - y0) : Infinity);
  scale = isFinite(fit) ? fit : 1;
  left = width / 2 - scale * (x0 + x1) / 2; base = (height + head) / 2 + scale * (y0 + y1) / 2;
  addAxes();
  let ground, top;  // what belongs to the ground but lies over the bars
  [ground, trails, mobile, top] = [0, 0, 0, 0].map(() => make("g", {}, plane));
  D.items.forEach(item => addItem(item, item.role === "ground pin" ? top : D.styles[item.role].fixed ? ground : mobile));
  D.labels.forEach(addLabel);
  keys.forEach((set, i) => addArrows(set, above + 14 + 18 * i));
  drawTraces(); show(k);
}
function drawPose(failed, ready) {
  if (ready) moving.forEach(update => update());
  seen(mobile, ready);
  mobile.classList.toggle("faded", failed);
  handled?.grips();
}
function drawTraces() {
  trails.replaceChildren();
  for (const column of traces) make("path", { class: "trail", style: `stroke:${paint("body", D.points[column].body)}`, d: curve(path(column).map(p => p && at(p))) }, trails);
}
