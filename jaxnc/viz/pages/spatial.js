const canvas = $("drawing"), pen = canvas.getContext("2d");
// Small vectors.
const at = placed, less = (a, b) => plus(a, -1, b), dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]], times = (s, a) => a.map(x => s * x), size3 = a => sqrt(dot(a, a));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

// The view: turn about z and tilt, radians; zoom; shift on the screen, pixels. Then what follows from it.
const home = { turn: D.view[1] * PI / 180, tilt: D.view[0] * PI / 180 };
let view = { ...home, zoom: 1, x: 0, y: 0 }, width = 0, height = 0, fitted = 1, scale = 1, u = 5, unit = 1, right, up, near, colours = {};
let named = true, vectors = true, failing = false, ready = false;
const middle = D.box[0].map((low, i) => 0.5 * (low + D.box[1][i])), light = [-0.38, 0.62, 0.69];
const base = () => max(3.2, min(5.6, min(width, height) / 95));
function aim() {
  const [c, s, ce, se] = [cos(view.turn), sin(view.turn), cos(view.tilt), sin(view.tilt)];
  right = [-s, c, 0]; near = [ce * c, ce * s, se]; up = cross(near, right);
  scale = fitted * view.zoom; u = base() * sqrt(view.zoom); unit = u / scale;
}
const across = p => { const q = less(p, middle); return [dot(q, right), dot(q, up)]; };
const flat = p => { const [x, y] = across(p); return [width / 2 + view.x + scale * x, height / 2 + view.y - scale * y]; };
const depth = p => dot(less(p, middle), near);
// The scale at which everything is in view from the first direction.
function measure() {
  const keep = view, there = handled?.altered() ? handled.everywhere() : D.seen;
  view = { ...home, zoom: 1 }; aim();
  const corners = there.map(across), [[x0, x1], [y0, y1]] = [extent(corners, 0), extent(corners, 1)], pad = 12.8 * base();  // the buttons lie above
  fitted = min(max(width - pad, 40) / (x1 - x0), max(height - pad - 40, 40) / (y1 - y0));
  if (!isFinite(fitted)) fitted = 1;
  home.x = -0.5 * (x0 + x1) * fitted; home.y = 0.5 * (y0 + y1) * fitted + 14;
  view = keep;
}

// Colours as numbers, so that they can be shaded; read from the page's style, light or dark.
const colour = (name, body) => {
  const key = /body|tint/.test(name) ? paint(name, body).slice(4, -1) : "--" + name;
  return colours[key] ??= [1, 3, 5].map(i => parseInt(getComputedStyle(owner).getPropertyValue(key).trim().slice(i, i + 2), 16));
};
const css = (c, opacity = 1) => `rgba(${c[0] | 0},${c[1] | 0},${c[2] | 0},${opacity})`;
function shaded(c, lit) {
  const dark = min(0.4, max(0, (0.55 - lit) * 0.3)), bright = min(0.28, max(0, (lit - 0.55) * 0.55));
  return c.map(v => { v *= 1 - dark; return v + (255 - v) * bright; });
}
const edging = (style, item) => style.stroke === "shade" ? times(0.62, colour(style.fill, item.body)) : colour(style.stroke, item.body);

// A frame: origin, three axes, and the length of its segment.
const read = ({ columns: [a, b], fixed }) => a === undefined ? fixed : b === undefined ? at(a) : less(at(b), at(a));
const unitary = v => times(1 / (size3(v) || 1), v);
function stand(frame) {
  const d = read(frame.along), span = size3(d), e = span > 0 ? unitary(d) : [1, 0, 0], beside = v => plus(v, -dot(v, e), e);
  let n = beside(frame.side ? read(frame.side) : [0, 0, 0]);
  if (!(size3(n) > 1e-6)) {
    const least = e.map(abs), axis = [0, 0, 0];
    axis[least.indexOf(min(...least))] = 1; n = beside(axis);
  }
  n = unitary(n);
  return { origin: at(frame.at), e, n, m: cross(e, n), span };
}

// Solids made of their pieces: vertices v, faces f, edges e (two vertices, the faces beside it, sharp), and their parts.
function solid(pieces) {
  const v = [], f = [], e = [], fp = [], ep = [], flag = x => x ? 1 : 0;
  let v0, f0, p0;
  const face = (part, corners) => { f.push(corners.map(i => i + v0)); fp.push(part + p0); };
  const edge = (part, a, b, s, t, sharp) => { e.push([a + v0, b + v0, s < 0 ? s : s + f0, t < 0 ? t : t + f0, flag(sharp)]); ep.push(part + p0); };
  for (const { rings, profile, coil, sides: n, prism, caps, lined, v: plain, f: flats, strokes, apart } of pieces) {
    v0 = v.length; f0 = f.length; p0 = 1 + max(-1, ...fp, ...ep);
    const way = i => { const t = turn * (i + (prism ? 0.5 : 0)) / n, s = prism ? 1 / cos(PI / n) : 1; return [s * cos(t), s * sin(t)]; };
    const each = f => { for (let i = 0; i < n; i++) f(i, (i + 1) % n, (i + n - 1) % n); };
    if (rings) {
      const last = rings.length - 2, end = (last + 1) * n, cap = [end, end + 1];
      for (const [share, long, units, r, thick] of rings) each(i => { const [c, s] = way(i); v.push([share, long, r * c, r * s, units, thick * c, thick * s]); });
      for (let a = 0; a < end; a += n) each((i, j) => face(a / n, [a + i, a + j, a + n + j, a + n + i]));
      if (caps) { const all = []; each(i => all.push(i)); face(0, all.slice().reverse()); face(last, all.map(i => end + i)); }
      for (let part = 0; part <= last; part++) each((i, j, h) => {
        const a = part * n;
        edge(part, a + i, a + n + i, a + h, a + i, prism);
        [part === 0, part === last].forEach((ends, b) => { if (ends ? caps : lined) edge(part, a + b * n + i, a + b * n + j, a + i, ends ? cap[b] : a + i, 1); });
      });
    } else if (profile) {
      const last = profile.length - 1;
      profile.forEach(([a, r], j) => each((i, next, back) => {
        const [c, s] = way(i), p = j * n + i, q = j * n + next;
        v.push([0, a, r * c, r * s, 0, 0, 0]);
        if (j < last) { face(p, [p, q, q + n, p + n]); edge(p, p, p + n, j * n + back, p, 0); }
        edge(j < last ? p : p - n, p, q, j ? p - n : -1, j < last ? p : -1, j === 0 || j === last);
      }));
    } else if (coil) {
      const [turns, r, start, end] = coil, count = turns * n;
      for (let i = 0; i <= count; i++) { const [c, s] = way(i), x = i / count; v.push([x, 0, 0, 0, start * (1 - x) - end * x, r * c, r * s]); if (i) edge(i - 1, i - 1, i, -1, -1, 1); }
    } else {
      v.push(...plain); flats.forEach(corners => face(0, corners));
      strokes.forEach(([a, b], i) => edge(apart ? i : 0, a, b, -1, -1, 1));
    }
  }
  const parts = new Array(1 + max(-1, ...fp, ...ep)).fill(1);
  for (const p of fp) parts[p] = 0;
  return { v, f, e, fp, ep, parts, shares: v.some(x => x[0]) };
}
D.meshes = D.meshes.map(solid);
let sheet = [];
// What is painted from behind to before: faces (kind 0) and lines (kind 1), faint where the pose is not right.
const lay = (style, d, kind, paint) => sheet.push({ d, kind, paint: failing && !style.fixed ? () => { pen.globalAlpha = 0.14; paint(); pen.globalAlpha = 1; } : paint });
const trail = points => { pen.beginPath(); for (const p of points) pen.lineTo(...p); };
const outlined = (c, thick) => { pen.strokeStyle = css(c); pen.lineWidth = thick; pen.stroke(); };
const layFace = (style, d, points, c, opacity, kind = 0) => lay(style, d, kind, () => { trail(points); pen.closePath(); pen.fillStyle = css(c, opacity); pen.fill(); if (opacity === 1) outlined(c, 0.7); });
const stroke = (points, c, thick) => { trail(points); pen.lineCap = pen.lineJoin = "round"; outlined(c, thick); };
const layLine = (style, places, c, thick) => { const [p, q] = places; lay(style, (depth(p) + depth(q)) / 2, 1, () => stroke(places.map(flat), c, thick)); };
// Twice the signed area of a polygon on the screen; positive if its outside is seen.
const area = points => points.reduce((sum, b, i) => { const a = points.at(i - 1); return sum + b[0] * a[1] - b[1] * a[0]; }, 0);
const normal = points => unitary(points.slice(2).reduce((sum, p, i) => plus(sum, 1, cross(less(points[i + 1], points[0]), less(p, points[0]))), [0, 0, 0]));
const lit = n => light[0] * dot(n, right) + light[1] * dot(n, up) + light[2] * dot(n, near);

const draw = {
  solid(item) {
    const style = D.styles[item.role], mesh = D.meshes[item.mesh], f = stand(item.frame);
    if (!(f.span > 0) && mesh.shares) return;
    const places = mesh.v.map(v => {
      const a = f.span * v[0] + v[1] + unit * v[4], b = v[2] + unit * v[5], c = v[3] + unit * v[6];
      return plus(plus(plus(f.origin, a, f.e), b, f.n), c, f.m);
    });
    const spots = places.map(flat), far = places.map(depth), parts = mesh.parts.map(() => [0, 0]);
    const front = mesh.f.map(face => area(face.map(i => spots[i])) > 0);
    mesh.f.forEach((face, i) => { const p = parts[mesh.fp[i]]; p[0] += face.reduce((s, v) => s + far[v], 0) / face.length; p[1]++; });
    mesh.e.forEach((edge, i) => { const p = parts[mesh.ep[i]]; if (mesh.parts[mesh.ep[i]]) { p[0] += 0.5 * (far[edge[0]] + far[edge[1]]); p[1]++; } });
    const where = parts.map(p => p[0] / max(p[1], 1) + 0.9 * unit * style.layer), fill = style.fill && colour(style.fill, item.body);
    mesh.f.forEach((face, i) => {
      if (front[i]) layFace(style, where[mesh.fp[i]], face.map(v => spots[v]), shaded(fill, lit(normal(face.map(v => places[v])))), style.opacity);
    });
    if (!style.stroke || !style.width) return;
    const c = edging(style, item);
    mesh.e.forEach(([a, b, s, t, sharp], i) => {
      const fs = s < 0 || front[s], ft = t < 0 || front[t];
      if (sharp ? fs || ft : fs !== ft) lay(style, where[mesh.ep[i]], 1, () => stroke([spots[a], spots[b]], c, style.width * u));
    });
  },
  plate(item) {
    const style = D.styles[item.role];
    for (const face of item.faces) {
      const places = face.map(at);
      layFace(style, places.reduce((s, p) => s + depth(p), 0) / places.length, places.map(flat), shaded(colour(style.fill, item.body), abs(lit(normal(places)))), style.opacity);
    }
  },
  ball(item) {
    const style = D.styles[item.role], p = at(item.at), [x, y] = flat(p), r = item.units * u, c = colour(style.fill, item.body);
    lay(style, depth(p) + 0.9 * unit * style.layer, 0, () => {
      pen.beginPath(); pen.arc(x, y, r, 0, turn);
      const glow = pen.createRadialGradient(x - 0.36 * r, y - 0.45 * r, 0.1 * r, x, y, 1.05 * r);
      for (const [stop, lit] of [[0, 1], [0.55, 0.3], [1, -0.6]]) glow.addColorStop(stop, css(shaded(c, lit)));
      pen.fillStyle = glow; pen.fill();
      outlined(edging(style, item), style.width * u);
    });
  },
  turn(item) {
    const style = D.styles[item.role], f = stand({ at: item.at, along: item.axis, side: item.to }), r = item.units * unit;
    const shown = swept(D.scalars[item.scalar].values[k], item.low);
    const spot = (angle, radius) => plus(plus(f.origin, radius * cos(angle), f.n), radius * sin(angle), f.m);
    const c = colour(style.stroke, item.body), curve = [];
    for (let i = 0; i <= 32; i++) curve.push(spot(-shown * (1 - i / 32), r));
    const tip = curve[32], head = min(abs(shown), 1.5 / item.units) * sign(shown);
    for (let i = 0; i < 32; i++) if (abs(shown) * (1 - i / 32) > 0.8 * abs(head)) layLine(style, [curve[i], curve[i + 1]], c, style.width * u);
    layFace(style, depth(tip), [tip, spot(-head, r + 0.55 * unit), spot(-head, r - 0.55 * unit)].map(flat), c, 1, 1);
    layLine(style, [spot(-shown, 0.25 * r), spot(-shown, 1.35 * r)], c, 0.16 * u);
    const aside = (shown < 0 ? -0.5 : 0.5) * max(0, 1 - abs(shown) / 0.9);
    const [x, y] = flat(spot(-0.5 * shown - aside, r + 1.9 * unit));
    words.push([item.text, [x + item.dx * u, y - item.dy * u], "soft", ""]);
  },
};
let words = [];
function addTraces() {
  for (const column of traces) path(column).reduce((p, q) => { if (p && q) layLine({ fixed: true }, [p, q], colour("body", columns[column].body), 1.5); return q; }, null);
}
// A grid on the floor of the box, so that turning can be seen, and the directions of the axes.
function addFloor() {
  const [step, digits] = stepped(70 / scale), z = D.box[0][2] - 3.6 * unit, corner = [38, height - 40];
  const [x0, y0] = D.box[0].map(v => floor((v - 2 * unit) / step)), [x1, y1] = D.box[1].map(v => ceil((v + 2 * unit) / step));
  if (x1 - x0 > 80 || y1 - y0 > 80) return;
  const rule = (...ends) => stroke(ends.map(([x, y]) => flat([x * step, y * step, z])), colour("line"), 1);
  for (let x = x0; x <= x1; x++) rule([x, y0], [x, y1]);
  for (let y = y0; y <= y1; y++) rule([x0, y], [x1, y]);
  letters(`grid ${step.toFixed(digits)}${D.unit ? " " + D.unit : ""}`, [width - 8, height - 12], "soft", "", 11, "right");
  axes.forEach((name, i) => {
    const way = s => [corner[0] + s * right[i], corner[1] - s * up[i]];
    stroke([corner, way(24)], colour("soft"), 1.4);
    letters(name, way(33), "soft", "", 12);
  });
}
function letters(text, [x, y], name, look, size, align = "center") {
  pen.font = `${look} ${size}px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif`;
  pen.textAlign = align; pen.textBaseline = "middle"; pen.lineJoin = "round";
  pen.strokeStyle = css(colour("paper"), 0.8); pen.lineWidth = 0.25 * size; pen.strokeText(text, x, y);
  pen.fillStyle = css(colour(name)); pen.fillText(text, x, y);
}
let asked = false;
function refresh() { if (!asked) { asked = true; raf(() => { asked = false; paintAll(); }); } }
function paintAll() {
  if (!width || !height) return;
  const ratio = window.devicePixelRatio || 1, [wide, high] = [width, height].map(x => round(x * ratio));
  if (canvas.width !== wide || canvas.height !== high) { canvas.width = wide; canvas.height = high; }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  aim();
  addFloor();
  sheet = []; words = [];
  for (const item of D.items) {
    if (!ready && !D.styles[item.role].fixed) continue;
    if (!vectors && (item.role === "axis" || item.role === "ground axis") || item.force && !acting()) continue;
    draw[item.shape](item);
  }
  addTraces();
  sheet.sort((a, b) => a.d - b.d || a.kind - b.kind).forEach(part => part.paint());
  const text = max(11, min(17, 2.1 * u));
  if (ready && named) for (const label of D.labels) {
    if (label.way && !vectors) continue;
    let p = at(label.at);
    if (label.way) { p = plus(p, label.further + label.reach * unit, unitary(read(label.way))); }
    if (label.to !== null) p = plus(p, 0.5, less(at(label.to), p));
    const [x, y] = flat(p);
    words.push([label.text, [x + label.dx * u, y - label.dy * u], label.to === null ? "ink" : "soft", label.way ? "italic bold" : "italic"]);
  }
  pen.globalAlpha = failing ? 0.3 : 1;
  for (const [what, place, name, look] of words) letters(what, place, name, look, text);
  pen.globalAlpha = 1;
  D.arrows.forEach((set, i) => set.order > 1 && !acting() || letters(set.text, [12, 16 + 18 * i], set.noun, "", 12, "left"));
}
function drawPose(failed, placed) { failing = failed; ready = placed; refresh(); }
function drawTraces() { refresh(); }
function layout() {
  const box = canvas.getBoundingClientRect();
  if (!box.width || !box.height) return;
  const moved = [view.x - (home.x || 0), view.y - (home.y || 0)], first = !width;
  width = box.width; height = box.height;
  colours = {}; measure();
  view.x = home.x + (first ? 0 : moved[0]); view.y = home.y + (first ? 0 : moved[1]);
  show(k); paintAll();
}
// Turning, shifting and zooming: mouse, touch and keys.
function look(change) { Object.assign(view, change); view.tilt = max(-PI / 2, min(PI / 2, view.tilt)); refresh(); }
function zoomAt(factor, x, y) {
  const zoom = max(0.2, min(40, view.zoom * factor)), f = zoom / view.zoom, cx = x - width / 2, cy = y - height / 2;
  look({ zoom, x: cx + (view.x - cx) * f, y: cy + (view.y - cy) * f });
}
const reset = () => { measure(); look({ ...home, zoom: 1 }); };
const fingers = new Map();
on(canvas, "pointerdown", event => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, [event.offsetX, event.offsetY]); });
on(canvas, "pointerup pointercancel", event => fingers.delete(event.pointerId));
on(canvas, "pointermove", event => {
  const before = fingers.get(event.pointerId), here = [event.offsetX, event.offsetY];
  if (!before) return;
  const dx = here[0] - before[0], dy = here[1] - before[1];
  if (fingers.size === 2) {
    const other = [...fingers].find(([id]) => id !== event.pointerId)[1], [was, is] = [before, here].map(p => hypot(p[0] - other[0], p[1] - other[1]));
    look({ x: view.x + dx / 2, y: view.y + dy / 2 });
    if (was > 4) zoomAt(is / was, (here[0] + other[0]) / 2, (here[1] + other[1]) / 2);
  } else if (event.shiftKey || event.ctrlKey || (event.buttons & 6)) look({ x: view.x + dx, y: view.y + dy });
  else look({ turn: view.turn - 0.008 * dx, tilt: view.tilt + 0.008 * dy });
  fingers.set(event.pointerId, here);
});
on(canvas, "contextmenu", event => event.preventDefault());
on(canvas, "wheel", event => { event.preventDefault(); zoomAt(Math.exp(-0.0015 * event.deltaY * (event.deltaMode ? 30 : 1)), event.offsetX, event.offsetY); }, { passive: false });
on(canvas, "dblclick", reset);
on(canvas, "keydown", event => {
  if (chorded(event)) return;
  const way = ways[event.key];
  if (way && event.shiftKey) look({ x: view.x + 20 * way[0], y: view.y + 20 * way[1] });
  else if (way) look({ turn: view.turn - 0.09 * way[0], tilt: view.tilt + 0.09 * way[1] });
  else if (event.key === "+" || event.key === "=") zoomAt(1.2, width / 2, height / 2);
  else if (event.key === "-") zoomAt(1 / 1.2, width / 2, height / 2);
  else if (event.key === "0") reset();
  else return;
  event.preventDefault(); event.stopPropagation();
});
on($("home"), "click", reset);
const faces = { front: [-PI / 2, 0], side: [0, 0], top: [-PI / 2, PI / 2] };
for (const name in faces) on($(name), "click", () => look({ turn: faces[name][0], tilt: faces[name][1] }));
on($("names"), "change", event => { named = event.target.checked; refresh(); });
on($("arrows"), "change", event => { vectors = event.target.checked; refresh(); });
$("arrows").parentNode.hidden = !D.directions.length;
on(matchMedia("(prefers-color-scheme: dark)"), "change", () => { colours = {}; refresh(); });
