const canvas = $("drawing"), pen = canvas.getContext("2d");
// Small vectors.
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]], dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const plus = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]], size3 = a => sqrt(dot(a, a));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const columns = [...D.points, ...D.directions, ...D.tips];
const at = c => [columns[c].x[k], columns[c].y[k], columns[c].z[k]];

// The view: turn about z and tilt, radians; zoom; shift on the screen, pixels. Then what follows from it.
const home = { turn: D.view[1] * PI / 180, tilt: D.view[0] * PI / 180 };
let view = { ...home, zoom: 1, x: 0, y: 0 }, width = 0, height = 0, scale = 1, u = 5, unit = 1, right, up, near, colours = {};
let named = true, vectors = true, failing = false, ready = false;
const middle = D.box[0].map((low, i) => 0.5 * (low + D.box[1][i]));
const light = [-0.38, 0.62, 0.69], twin = 2 * PI;
function aim() {
  const [c, s, ce, se] = [cos(view.turn), sin(view.turn), cos(view.tilt), sin(view.tilt)];
  right = [-s, c, 0]; near = [ce * c, ce * s, se]; up = cross(near, right);
  scale = fit() * view.zoom; u = base() * sqrt(view.zoom); unit = u / scale;
}
const base = () => max(3.2, min(5.6, min(width, height) / 95));
let fitted = 1;
const fit = () => fitted;
// The scale at which everything is in view from the first direction.
function measure() {
  const keep = { ...view };
  view = { ...home, zoom: 1, x: 0, y: 0 }; fitted = 1; aim();
  let low = [Infinity, Infinity], high = [-Infinity, -Infinity];
  for (const corner of D.seen) {
    const q = sub(corner, middle), p = [dot(q, right), dot(q, up)];
    for (const i of [0, 1]) { low[i] = min(low[i], p[i]); high[i] = max(high[i], p[i]); }
  }
  const pad = 2 * 6.4 * base(), room = [width - pad, height - pad - 40];  // the buttons lie above
  fitted = min(...[0, 1].map(i => high[i] > low[i] ? max(room[i], 40) / (high[i] - low[i]) : Infinity));
  if (!isFinite(fitted)) fitted = 1;
  home.x = -0.5 * (low[0] + high[0]) * fitted; home.y = 0.5 * (low[1] + high[1]) * fitted + 14;
  view = keep;
}
const flat = p => { const q = sub(p, middle); return [width / 2 + view.x + scale * dot(q, right), height / 2 + view.y - scale * dot(q, up)]; };
const depth = p => dot(sub(p, middle), near);

// Colours as numbers, so that they can be shaded; read from the page's style, light or dark.
function readColours() {
  const style = getComputedStyle(owner), probe = name => {
    const hex = style.getPropertyValue(name).trim();
    return [1, 3, 5].map(i => parseInt(hex.slice(i, i + 2), 16));
  };
  colours = { names: {}, probe };
}
function colour(name, body) {
  const key = name === "body" || name === "tint" ? `--${name}-${body < 0 ? "ink" : body % 10}` : `--${name}`;
  return colours.names[key] || (colours.names[key] = colours.probe(key));
}
const css = (c, opacity) => `rgba(${c[0] | 0},${c[1] | 0},${c[2] | 0},${opacity})`;
function shaded(c, lit) {
  const dark = min(0.4, max(0, (0.55 - lit) * 0.3)), bright = min(0.28, max(0, (lit - 0.55) * 0.55));
  return c.map(v => { v *= 1 - dark; return v + (255 - v) * bright; });
}
const stroke = (style, item) => style.stroke === "shade" ? colour(style.fill, item.body).map(v => 0.62 * v) : colour(style.stroke, item.body);

// A frame: origin, three axes, and the length of its segment.
const read = way => !way.columns.length ? way.fixed : way.columns.length === 1 ? at(way.columns[0]) : sub(at(way.columns[1]), at(way.columns[0]));
function stand(frame) {
  const origin = Array.isArray(frame.at) ? frame.at : at(frame.at), d = read(frame.along), span = size3(d);
  const e = span > 0 ? d.map(v => v / span) : [1, 0, 0];
  let n = frame.side ? read(frame.side) : [0, 0, 0];
  n = plus(n, -dot(n, e), e);
  if (!(size3(n) > 1e-6)) {
    const least = e.map(abs), i = least.indexOf(min(...least)), axis = [0, 0, 0];
    axis[i] = 1; n = plus(axis, -dot(axis, e), e);
  }
  const s = size3(n); n = n.map(v => v / s);
  return { origin, e, n, m: cross(e, n), span };
}

// Solids made of their pieces: vertices v, faces f, edges e (two vertices, the faces beside it, sharp), and their parts.
function solid(pieces) {
  const v = [], f = [], e = [], fp = [], ep = [], flag = x => x ? 1 : 0;
  let v0, f0, p0;
  const face = (part, corners) => { f.push(corners.map(i => i + v0)); fp.push(part + p0); };
  const edge = (part, a, b, s, t, sharp) => { e.push([a + v0, b + v0, s < 0 ? s : s + f0, t < 0 ? t : t + f0, flag(sharp)]); ep.push(part + p0); };
  for (const { rings, profile, coil, sides: n, prism, caps, lined, v: plain, f: flats, strokes, apart } of pieces) {
    v0 = v.length; f0 = f.length; p0 = 1 + max(-1, ...fp, ...ep);
    const way = i => { const t = twin * (i + (prism ? 0.5 : 0)) / n, s = prism ? 1 / cos(PI / n) : 1; return [s * cos(t), s * sin(t)]; };
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
const put = (d, kind, paint) => sheet.push({ d, kind, paint });
const trail = points => { pen.beginPath(); points.forEach((p, i) => i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])); };
function fillFace(points, c, opacity) {
  return () => { trail(points); pen.closePath(); pen.fillStyle = css(c, opacity); pen.fill();
    if (opacity === 1) { pen.strokeStyle = pen.fillStyle; pen.lineWidth = 0.7; pen.stroke(); } };
}
function strokeLine(points, c, thick) {
  return () => { trail(points); pen.strokeStyle = css(c, 1); pen.lineWidth = thick; pen.lineCap = "round"; pen.lineJoin = "round"; pen.stroke(); };
}
const dimmed = (style, paint) => failing && !style.fixed ? () => { pen.globalAlpha = 0.14; paint(); pen.globalAlpha = 1; } : paint;
// Twice the signed area of a polygon on the screen; positive if its outside is seen.
function area(points) {
  let sum = 0;
  for (let i = 0; i < points.length; i++) { const a = points[i], b = points[(i + 1) % points.length]; sum += a[0] * b[1] - a[1] * b[0]; }
  return -sum;
}
function normal(points) {
  const o = points[0];
  let sum = [0, 0, 0];
  for (let i = 1; i + 1 < points.length; i++) sum = plus(sum, 1, cross(sub(points[i], o), sub(points[i + 1], o)));
  const s = size3(sum) || 1;
  return sum.map(v => v / s);
}
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
      if (front[i]) put(where[mesh.fp[i]], 0, dimmed(style, fillFace(face.map(v => spots[v]), shaded(fill, lit(normal(face.map(v => places[v])))), style.opacity)));
    });
    if (!style.stroke || !style.width) return;
    const c = stroke(style, item);
    mesh.e.forEach((edge, i) => {
      const [a, b, s, t, sharp] = edge, fs = s < 0 || front[s], ft = t < 0 || front[t];
      if (sharp ? fs || ft : fs !== ft) put(where[mesh.ep[i]], 1, dimmed(style, strokeLine([spots[a], spots[b]], c, style.width * u)));
    });
  },
  plate(item) {
    const style = D.styles[item.role];
    for (const face of item.faces) {
      const places = face.map(at);
      put(places.reduce((s, p) => s + depth(p), 0) / places.length, 0,
        dimmed(style, fillFace(places.map(flat), shaded(colour(style.fill, item.body), abs(lit(normal(places)))), style.opacity)));
    }
  },
  ball(item) {
    const style = D.styles[item.role], p = at(item.at), [x, y] = flat(p), r = item.units * u, c = colour(style.fill, item.body);
    put(depth(p) + 0.9 * unit * style.layer, 0, dimmed(style, () => {
      pen.beginPath(); pen.arc(x, y, r, 0, twin);
      const glow = pen.createRadialGradient(x - 0.36 * r, y - 0.45 * r, 0.1 * r, x, y, 1.05 * r);
      glow.addColorStop(0, css(shaded(c, 1), 1)); glow.addColorStop(0.55, css(shaded(c, 0.3), 1)); glow.addColorStop(1, css(shaded(c, -0.6), 1));
      pen.fillStyle = glow; pen.fill();
      pen.strokeStyle = css(stroke(style, item), 1); pen.lineWidth = style.width * u; pen.stroke();
    }));
  },
  turn(item) {
    const style = D.styles[item.role], f = stand({ at: item.at, along: item.axis, side: item.to }), r = item.units * unit, full = twin;
    const value = D.turns[item.scalar][k];
    let shown = ((((value - item.low) % full) + full) % full) + item.low;
    if (abs(shown) > full - 1e-6) shown -= sign(shown) * full;
    const spot = (angle, radius) => plus(plus(f.origin, radius * cos(angle), f.n), radius * sin(angle), f.m);
    const c = colour(style.stroke, item.body), curve = [];
    for (let i = 0; i <= 32; i++) curve.push(spot(-shown * (1 - i / 32), r));
    const tip = curve[32], head = min(abs(shown), 1.5 / item.units) * sign(shown), show1 = (points, thick) =>
      put(depth(points[0]) / 2 + depth(points[1]) / 2, 1, dimmed(style, strokeLine(points.map(flat), c, thick)));
    for (let i = 0; i < 32; i++) if (shown * (1 - i / 32) * sign(shown) > 0.8 * abs(head)) show1([curve[i], curve[i + 1]], style.width * u);
    put(depth(tip), 1, dimmed(style, fillFace([tip, spot(-head, r + 0.55 * unit), spot(-head, r - 0.55 * unit)].map(flat), c, 1)));
    show1([spot(-shown, 0.25 * r), spot(-shown, 1.35 * r)], 0.16 * u);
    const aside = (shown < 0 ? -0.5 : 0.5) * max(0, 1 - abs(shown) / 0.9);
    const [x, y] = flat(spot(-0.5 * shown - aside, r + 1.9 * unit));
    words.push([item.text, [x + item.dx * u, y - item.dy * u], "--soft", ""]);
  },
};
let words = [];
function addTraces() {
  for (const column of traces) {
    const f = D.fine[column], p = f || columns[column], c = colour("body", columns[column].body);
    let before = null;
    for (let i = 0; i < (f ? f.x.length : D.poses); i++) {
      if (D.status[i] === "waiting") continue;
      const here = !f && D.status[i] || p.x[i] === null ? null : [p.x[i], p.y[i], p.z[i]];
      if (before && here) put(0.5 * (depth(before) + depth(here)), 1, strokeLine([flat(before), flat(here)], c, 1.5));
      before = here;
    }
  }
}
// A grid on the floor of the box, so that turning can be seen, and the directions of the axes.
function addFloor() {
  const raw = 70 / scale, power = Math.pow(10, floor(log10(raw))), step = [1, 2, 5, 10].map(s => s * power).find(s => s >= raw);
  const z = D.box[0][2] - 3.6 * unit, low = [0, 1].map(i => floor((D.box[0][i] - 2 * unit) / step) * step);
  const high = [0, 1].map(i => ceil((D.box[1][i] + 2 * unit) / step) * step), c = colour("line");
  if ((high[0] - low[0]) / step > 80 || (high[1] - low[1]) / step > 80) return;
  for (let x = low[0]; x <= high[0] + 0.5 * step; x += step) strokeLine([flat([x, low[1], z]), flat([x, high[1], z])], c, 1)();
  for (let y = low[1]; y <= high[1] + 0.5 * step; y += step) strokeLine([flat([low[0], y, z]), flat([high[0], y, z])], c, 1)();
  const digits = max(0, -floor(log10(step) + 1e-9)), corner = [38, height - 40];
  write(`grid ${step.toFixed(digits)}${D.unit ? " " + D.unit : ""}`, [width - 8, height - 12], "--soft", "", 11, "right");
  ["x", "y", "z"].forEach((name, i) => {
    const axis = [0, 0, 0]; axis[i] = 1;
    const way = [dot(axis, right), -dot(axis, up)];
    strokeLine([corner, [corner[0] + 24 * way[0], corner[1] + 24 * way[1]]], colour("soft"), 1.4)();
    write(name, [corner[0] + 33 * way[0], corner[1] + 33 * way[1]], "--soft", "", 12);
  });
}
function write(text, [x, y], name, look, size, align) {
  pen.font = `${look} ${size}px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif`;
  pen.textAlign = align || "center"; pen.textBaseline = "middle"; pen.lineJoin = "round";
  pen.strokeStyle = css(colour("paper"), 0.8); pen.lineWidth = 0.25 * size; pen.strokeText(text, x, y);
  pen.fillStyle = css(colour(name.slice(2)), 1); pen.fillText(text, x, y);
}
function addArrowKeys() {
  D.arrows.forEach((text, i) => text[2] && !acting() || write(text[1], [12, 16 + 18 * i], "--" + text[0], "", 12, "left"));
}
let asked = false;
function refresh() { if (!asked) { asked = true; raf(() => { asked = false; paintAll(); }); } }
function paintAll() {
  if (!width || !height) return;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== round(width * ratio) || canvas.height !== round(height * ratio)) { canvas.width = round(width * ratio); canvas.height = round(height * ratio); }
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
    if (label.way) { const d = read(label.way), s = size3(d) || 1; p = plus(p, (label.further + label.reach * unit) / s, d); }
    if (label.to !== null) p = plus(p, 0.5, sub(at(label.to), p));
    const [x, y] = flat(p);
    words.push([label.text, [x + label.dx * u, y - label.dy * u], label.to === null ? "--ink" : "--soft", label.way ? "italic bold" : "italic"]);
  }
  pen.globalAlpha = failing ? 0.3 : 1;
  for (const [what, place, name, look] of words) write(what, place, name, look, text);
  pen.globalAlpha = 1;
  addArrowKeys();
}
function drawPose(failed, placed) { failing = failed; ready = placed; refresh(); }
function drawTraces() { refresh(); }
function layout() {
  const box = canvas.getBoundingClientRect();
  if (!box.width || !box.height) return;
  const moved = [view.x - (home.x || 0), view.y - (home.y || 0)], first = !width;
  width = box.width; height = box.height;
  readColours(); measure();
  view.x = home.x + (first ? 0 : moved[0]); view.y = home.y + (first ? 0 : moved[1]);
  show(k); paintAll();
}
// Turning, shifting and zooming: mouse, touch and keys.
function look(change) { Object.assign(view, change); view.tilt = max(-PI / 2, min(PI / 2, view.tilt)); refresh(); }
function zoomAt(factor, x, y) {
  const zoom = max(0.2, min(40, view.zoom * factor)), f = zoom / view.zoom, cx = x - width / 2, cy = y - height / 2;
  look({ zoom, x: cx + (view.x - cx) * f, y: cy + (view.y - cy) * f });
}
const reset = () => look({ ...home, zoom: 1 });
const fingers = new Map();
on(canvas, "pointerdown", event => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, [event.offsetX, event.offsetY]); });
for (const end of ["pointerup", "pointercancel"]) on(canvas, end, event => fingers.delete(event.pointerId));
on(canvas, "pointermove", event => {
  const before = fingers.get(event.pointerId), here = [event.offsetX, event.offsetY];
  if (!before) return;
  const dx = here[0] - before[0], dy = here[1] - before[1];
  if (fingers.size === 2) {
    const other = [...fingers.entries()].find(([id]) => id !== event.pointerId)[1];
    const was = hypot(before[0] - other[0], before[1] - other[1]), is = hypot(here[0] - other[0], here[1] - other[1]);
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
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
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
if (!D.directions.length) $("arrows").parentNode.hidden = true;
on(matchMedia("(prefers-color-scheme: dark)"), "change", () => { readColours(); refresh(); });
