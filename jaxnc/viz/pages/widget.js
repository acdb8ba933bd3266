// Beside what a page does by itself: what is shown is told to Python, and what Python says is shown.
const me = "page " + String(Math.random()).slice(2), told = JSON.stringify;
const numbers = ["q", "c", "k", "d"], live = handled;
let heard = "", late = false;
const state = () => { live?.take(); return live ? Object.fromEntries(numbers.map(name => [name, [...live.now[name]]])) : { pose: nearest }; };
function tell() {
  if (late || D.status[k] && !live) return;
  late = true;
  raf(() => {
    late = false;
    const found = state(), text = told(found);
    if (text === heard) return;
    heard = text;
    const q = live?.drawing();
    model.set("_now", { ...found, by: me, ...(q ? { drawn: [...q], m: [...live.markersAt(q)] } : {}) });
    model.save_changes();
  });
}
function hear() {
  const said = model.get("_now");
  if (!said?.by || said.by === me) return;
  if (!live) { heard = told({ pose: said.pose }); pause(); return show(said.pose); }
  const next = Object.fromEntries(numbers.map(name => [name, Float64Array.from(said[name])]));
  heard = told(Object.fromEntries(numbers.map(name => [name, said[name]])));
  pause();
  if (numbers.slice(1).every(name => next[name].every((x, i) => x === live.now[name][i]))) { live.now.q.set(next.q); live.present(); live.fit(0); }
  else { if (!held) live.remember(); live.back(next); if (!held) live.fit(0.6); }
  if (said.say) say(said.say);
  if (said.ack >= asked) { busy = false; if (next_pull) pull(...next_pull); }
}
// A curve is dragged: Python changes the dimensions by exact derivatives, one step after the other.
let held = null, busy = false, asked = 0, next_pull = null, drawing = null;
function pull(hold, place) {
  if (busy) { next_pull = [hold, place]; return; }
  busy = true; next_pull = null; asked++;
  model.set("_pull", { by: me, n: asked, point: D.points[hold.column].name, inputs: hold.inputs, place });
  model.save_changes();
}
function near(event) {
  const [x, y] = world(spot(event));
  let best = null, least = 12 / scale;
  for (const column of traces) for (let i = 0; i < D.poses; i++) if (!D.status[i]) {
    const p = D.points[column], far = hypot(p.x[i] - x, p.y[i] - y);
    if (far < least) { least = far; best = { column, inputs: live.askedOf(i) }; }
  }
  return best;
}
const goal = D.dim === 2 ? make("path", { class: "goal", style: "fill:none;stroke:var(--applied);stroke-width:2px;stroke-dasharray:6 4;pointer-events:none" }, svg) : null;
function drawGoal() {
  const said = drawing ? { points: drawing } : model.get("_target");
  give(goal, { d: said?.points?.length ? join(said.points.map(at), said.closed) : "" });
}
if (live && D.dim === 2) {
  const grips = live.grips, button = el("button");
  live.grips = () => { grips(); drawGoal(); };
  button.type = "button"; button.id = "pen"; button.textContent = "target"; button.title = "Draw the curve that is wanted";
  $("viewing").append(button);
  let pens = false;
  const mode = now => { pens = now; button.setAttribute("aria-pressed", now); svg.style.touchAction = now ? "none" : ""; svg.style.cursor = now ? "crosshair" : ""; };
  mode(false);
  on(button, "click", () => mode(!pens));
  on(svg, "pointerdown", event => {
    if (event.button) return;
    if (pens) { event.preventDefault(); event.stopPropagation(); drawing = [world(spot(event))]; svg.setPointerCapture(event.pointerId); return; }
    if (event.target.classList.contains("grip")) return;
    held = near(event);
    if (!held) return;
    event.preventDefault(); pause(); live.take(); live.remember(); svg.setPointerCapture(event.pointerId); svg.style.cursor = "grabbing";
  }, { capture: true });
  on(svg, "touchstart", event => { if (held || drawing) event.preventDefault(); }, { passive: false });
  on(svg, "pointermove", event => {
    if (drawing) { drawing.push(world(spot(event))); drawGoal(); }
    else if (held) pull(held, world(spot(event)));
    else if (!pens) svg.style.cursor = near(event) ? "grab" : "";
  });
  for (const end of ["pointerup", "pointercancel"]) on(svg, end, () => {
    if (drawing) {
      const points = drawing;
      drawing = null;
      if (points.length > 2 && end === "pointerup") { model.set("_target", { by: me, points }); model.save_changes(); mode(false); }
      drawGoal();
    }
    if (held) { held = null; svg.style.cursor = ""; }
  });
  model.on("change:_target", drawGoal);
}
model.on("change:_now", hear);
const watch = new MutationObserver(tell);
watch.observe(owner, { attributeFilter: ["data-pose"] });
until.signal.addEventListener("abort", () => { watch.disconnect(); model.off("change:_now", hear); model.off("change:_target", drawGoal); });
hear();
if (!heard) heard = told(state());  // as it begins, Python knows
