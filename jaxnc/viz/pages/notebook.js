{{PROGRAM}}
const STYLE = {{STYLE}}, BODY = {{BODY}}, DATA = {{DATA}};
// Whether the notebook round it is dark: VS Code says so, and paints white behind every widget. Elsewhere by what is painted
// behind, in any of CSS's ways of saying colours; where nothing is, letters are the lighter the darker that is.
const dim = place => {
  const told = document.body.dataset.vscodeThemeKind;
  if (told) return !/light$/.test(told);
  const pen = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const shade = (node, what) => {
    pen.clearRect(0, 0, 1, 1); pen.fillStyle = getComputedStyle(node)[what]; pen.fillRect(0, 0, 1, 1);
    const [r, g, b, opacity] = pen.getImageData(0, 0, 1, 1).data;
    return opacity > 127 ? 0.3 * r + 0.59 * g + 0.11 * b : NaN;
  };
  for (let node = place; node; node = node.assignedSlot || node.parentNode || node.host) {
    const behind = node.nodeType === 1 ? shade(node, "backgroundColor") : NaN;
    if (behind >= 0) return behind < 110;
  }
  return shade(place, "color") > 145;
};
const render = ({ model, el }) => {
  const host = document.createElement("div"), root = host.attachShadow({ mode: "open" }), sheet = new CSSStyleSheet(), body = document.createElement("template");
  host.className = "jaxnc";
  host.setAttribute("data-lm-suppress-shortcuts", "true");
  // Keys that a notebook would take for commands ("dd" deletes a cell) stay here; chords, F1 and Escape are the editor's.
  host.addEventListener("keydown", event => {
    if (!(event.ctrlKey || event.metaKey || event.altKey || /^(F\d+|Escape)$/.test(event.key))) event.stopPropagation();
  });
  sheet.replaceSync(STYLE);
  root.adoptedStyleSheets = [sheet];
  body.innerHTML = BODY;
  root.append(body.content);
  el.append(host);
  const shown = page(root, structuredClone(DATA), model);
  const look = () => {
    for (let node = host; (node = node.parentElement?.closest(".cell-output-ipywidget-background"));) node.style.setProperty("background", "none", "important");
    const name = dim(host.parentNode) ? "dark" : "light";
    if (name !== host.dataset.look) { host.dataset.look = name; shown.layout(); }
  };
  const later = () => { look(); setTimeout(look, 400); }, themes = new MutationObserver(later), there = new ResizeObserver(look);
  for (const node of [document.documentElement, document.body]) themes.observe(node, { attributes: true });
  there.observe(host);
  look();
  return () => { themes.disconnect(); there.disconnect(); shown.end(); host.remove(); };
};
export default { render };
