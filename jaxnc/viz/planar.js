const svg = $("drawing");
// State of the view: pixels per length, pixels per unit, and where the lower left corner is.
let u = 5, scale = 1, left = 0, base = 0, width = 0, height = 0, moving = [];
const spot = (node, [x, y]) => give(node, { x, y });
const X = x => left + x * scale, Y = y => base - y * scale;
const at = column => [X(D.points[column].x[k]), Y(D.points[column].y[k])];
const unitVector = (a, b) => {
  const [x0, y0] = at(a), [x1, y1] = at(b), size = hypot(x1 - x0, y1 - y0);
  return size > 0 ? [(x1 - x0) / size, (y1 - y0) / size] : [1, 0];
};
const stand = frame => {
  const origin = Array.isArray(frame.at) ? [X(frame.at[0]), Y(frame.at[1])] : at(frame.at);
  const e = frame.toward ? unitVector(frame.toward[0], frame.toward[1]) : [cos(frame.angle), -sin(frame.angle)];
  return [origin, e];
};
// A place in a frame, pixels: along its direction, and across to its left.
const inFrame = ([o, e], along, across) => [o[0] + along * e[0] + across * e[1], o[1] + along * e[1] - across * e[0]];
const join = (points, closed) => "M" + points.map(p => p[0].toFixed(2) + " " + p[1].toFixed(2)).join("L") + (closed ? "Z" : "");

const less = (p, q) => [p[0] - q[0], p[1] - q[1]], over = (p, q) => p[0] * q[1] - p[1] * q[0], apart = (a, b) => hypot(...less(at(a), at(b)));
const shapes = {
  line: item => join(item.points.map(at), item.closed),
  stamp: item => { const f = stand(item.frame); return join(item.vertices.map(v => inFrame(f, v[0] * scale + v[1] * u, v[2] * u)), item.closed); },
  circle: item => {
    const [x, y] = at(item.at), length = item.span ? apart(...item.span) : (handled && item.number >= 0 ? abs(handled.now.c[item.number]) : item.radius) * scale;
    const r = length + item.units * u;
    return `M${(x - r).toFixed(2)} ${y.toFixed(2)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
  },
  span: item => { const [a, b] = item.ends, f = [at(a), unitVector(a, b)], size = apart(a, b); return join(item.vertices.map(v => inFrame(f, v[0] * size + v[1] * u, v[2] * u)), item.closed); },
  casing: item => {
    const [a, b] = item.points.map(at), d = less(b, a), size = hypot(...d), clear = D.joint * u;
    let text = "";
    for (const pair of item.over) {
      const [p, q] = pair.map(at), w = less(p, a), f = less(q, p), other = hypot(...f), cross = over(d, f);
      const sine = abs(cross) / (size * other), s = over(w, f) / cross, t = over(w, d) / cross;
      const rest = min(s, 1 - s) * size, half = min(D.crossing * u / sine, rest - 0.5 * clear) / size;
      if (sine > D.shallow && rest > clear && min(t, 1 - t) * other > clear) text += join([s - half, s + half].map(x => [a[0] + x * d[0], a[1] + x * d[1]]), false);
    }
    return text;
  },
  hatch: item => {
    const f = stand(item.frame), lo = item.start[0] * scale + item.start[1] * u, hi = item.end[0] * scale + item.end[1] * u;
    const count = max(2, round((hi - lo) / (0.85 * u)));
    let d = "";
    for (let i = 0; i < count; i++) {
      const s = lo + (hi - lo) * (i + 0.75) / count;
      d += join([inFrame(f, s, item.offset * u), inFrame(f, s - 0.75 * u, (item.offset + 0.95 * item.side) * u)], false);
    }
    return d;
  },
};
const angles = item => {
  const from = item.start ? unitVector(item.start[0], item.start[1]) : [1, 0], to = unitVector(item.to[0], item.to[1]);
  const first = atan2(-from[1], from[0]), turn = 2 * PI;
  const extent = ((((atan2(-to[1], to[0]) - first - item.low) % turn) + turn) % turn) + item.low;
  return [first, abs(extent) > turn - 1e-6 ? extent - sign(extent) * turn : extent];
};
const polar = ([x, y], radius, angle) => [x + radius * cos(angle), y - radius * sin(angle)];

function addItem(item, parent) {
  if (item.shape === "arc") return addArc(item, parent);
  const style = D.styles[item.role], node = make("path", {}, parent);
  node.style.fill = paint(style.fill, item.body);
  node.style.fillOpacity = style.opacity;
  node.style.stroke = paint(style.stroke, item.body);
  node.style.strokeWidth = style.width * u + "px";
  node.style.strokeLinejoin = "round";
  node.style.strokeLinecap = style.width > 0.4 && !style.dash.length && item.shape !== "casing" ? "round" : "butt";
  if (style.dash.length) node.style.strokeDasharray = style.dash.map(d => d * u).join(" ");
  const update = () => give(node, { d: shapes[item.shape](item) });
  update(); moving.push(update);
}
function addArc(item, parent) {
  const colour = "var(--soft)", style = D.styles[item.role];
  const line = make("path", { fill: "none" }, parent), head = make("path", {}, parent), text = make("text", { "text-anchor": "middle", "dominant-baseline": "central" }, parent, item.text);
  line.style.stroke = colour; line.style.strokeWidth = style.width * u + "px";
  head.style.fill = colour; text.style.fill = colour;
  text.style.fontSize = 2.1 * u + "px";
  moving.push(() => {
    const centre = at(item.at), [first, extent] = angles(item), tip = sign(extent) * 1.5 / item.units, r = item.units * u, points = [];
    const long = abs(extent) > abs(tip), last = first + extent;
    for (let i = 0; i <= 40; i++) points.push(polar(centre, r, first + (long ? extent - 0.8 * tip : extent) * i / 40));
    give(line, { d: join(points, false) });
    give(head, { d: long ? join([polar(centre, r, last), polar(centre, r - 0.5 * u, last - tip), polar(centre, r + 0.5 * u, last - tip)], true) : "" });
    spot(text, polar(centre, item.beside * u, first + item.share * extent + item.lead));
  });
}
function addLabel(item, parent) {
  const text = make("text", { "text-anchor": "middle", "dominant-baseline": "central" }, parent, item.text);
  text.style.cssText = `fill:var(--ink);font-style:italic;font-size:${2.1 * u}px;paint-order:stroke;stroke:var(--paper);stroke-opacity:.8;stroke-width:${0.5 * u}px;stroke-linejoin:round`;
  moving.push(() => { const [x, y] = at(item.at), [a, b] = at(item.to ?? item.at); spot(text, [(x + a) / 2 + item.dx * u, (y + b) / 2 - item.dy * u]); });
}
function addArrows(set, parent) {
  const colour = `var(--${set.noun})`;
  const arrow = (x, y, dx, dy) => {
    const size = hypot(dx, dy), h = min(2 * u, size), w = 0.75 * u * h / (2 * u);
    if (!(size > 0.3)) return ["", ""];
    const ex = dx / size, ey = dy / size, bx = x + dx - h * ex, by = y + dy - h * ey;
    return [join([[x, y], [bx, by]], false), join([[x + dx, y + dy], [bx - w * ey, by + w * ex], [bx + w * ey, by - w * ex]], true)];
  };
  const pen = () => { const line = make("path", {}, parent), head = make("path", {}, parent);
    line.style.cssText = `stroke:${colour};stroke-width:${0.36 * u}px;fill:none`; head.style.fill = colour; return [line, head]; };
  if (set.feet) addForces(set, parent, arrow, pen);
  set.columns.forEach((column, i) => {
    const [line, head] = pen();
    moving.push(() => {
      const v = set.vectors[i][k], [x, y] = at(column), d = v[0] === null ? ["", ""] : arrow(x, y, v[0] * scale, -v[1] * scale);
      give(line, { d: d[0] }); give(head, { d: d[1] });
    });
  });
  if (!set.key) return;
  const row = (handled ? 52 : 14) + 18 * D.arrows.filter(a => a.key).indexOf(set), [line, head] = pen(), d = arrow(width - 14 - set.key * scale, row, set.key * scale, 0);
  svg.append(line, head);
  give(line, { d: d[0] }); give(head, { d: d[1] });
  const text = make("text", { x: width - 22 - set.key * scale, y: row, "text-anchor": "end", "dominant-baseline": "central" }, svg);
  text.textContent = set.text; text.style.cssText = `fill:${colour};font-size:12px`;
  if (set.feet) keyed([line, head, text]);
}
function addAxes(parent) {
  const text = (x, y, value, anchor) => { const t = make("text", { x, y, "text-anchor": anchor }, parent); t.textContent = value; t.style.cssText = "fill:var(--soft);font-size:11px"; };
  const rule = (x1, y1, x2, y2) => { make("line", { x1, y1, x2, y2 }, parent).style.cssText = "stroke:var(--line);stroke-width:1px"; };
  const marks = (low, high, long) => { const [values, digits] = ticks(low, high, long / 80); return values.map(v => [v, minus(v.toFixed(digits))]); };
  for (const [v, shown] of marks(-left / scale, (width - left) / scale, width)) {
    const x = X(v); rule(x, 0, x, height); if (x > 26 && x < width - 52) text(x, height - 5, shown, "middle");
  }
  for (const [v, shown] of marks((base - height) / scale, base / scale, height)) {
    const y = Y(v); rule(0, y, width, y); if (y > 28 && y < height - 22) text(4, y - 3, shown, "start");
  }
  text(width - 4, height - 5, D.unit ? `x [${D.unit}]` : "x", "end");
  text(4, 12, D.unit ? `y [${D.unit}]` : "y", "start");
}
// As the motion was given, with places between its poses where these are few.
const tracePath = column => { const f = !handled?.altered() && D.fine[column], p = f || D.points[column]; return curve(i => (f || !D.status[i]) && p.x[i] !== null, i => [X(p.x[i]), Y(p.y[i])], f ? f.x.length : D.poses); };
let mobile = make("g"), trails = make("g");
function layout() {
  const box = svg.getBoundingClientRect();
  width = box.width; height = box.height;
  if (!width || !height) return;
  svg.replaceChildren(); moving = [];
  give(svg, { viewBox: `0 0 ${width} ${height}` });
  u = max(3.4, min(6, min(width, height) / 85));
  const [[x0, y0], [x1, y1]] = D.box, pad = 7 * u, head = (handled ? 34 : 0) + 18 * D.arrows.filter(set => set.key).length;
  const fit = min(x1 > x0 ? (width - 2 * pad) / (x1 - x0) : Infinity, y1 > y0 ? (height - head - 2 * pad) / (y1 - y0) : Infinity);
  scale = isFinite(fit) ? fit : 1;
  left = width / 2 - scale * (x0 + x1) / 2; base = (height + head) / 2 + scale * (y0 + y1) / 2;
  addAxes(make("g", {}, svg));
  const ground = make("g", {}, svg);
  trails = make("g", {}, svg);
  mobile = make("g", {}, svg);
  const top = make("g", {}, svg);  // what belongs to the ground but lies over the bars
  D.items.forEach(item => addItem(item, item.role === "ground pin" ? top : D.styles[item.role].fixed ? ground : mobile));
  D.labels.forEach(item => addLabel(item, mobile));
  D.arrows.forEach(set => addArrows(set, mobile));
  handled?.grips();
  drawTraces(); show(k);
}
function drawPose(failed, placed) {
  if (placed) moving.forEach(update => update());
  give(mobile, { visibility: placed ? "visible" : "hidden" });
  mobile.classList.toggle("faded", failed);
}
function drawTraces() {
  trails.replaceChildren();
  for (const column of traces) {
    const node = make("path", { d: tracePath(column), fill: "none" }, trails);
    node.style.cssText = `stroke:${paint("body", D.points[column].body)};stroke-width:1.4px;stroke-linejoin:round`;
  }
}
