// The page of the desk: a map first, one panel beside it. Everything that is shown was computed by the server.
import { get } from "./server/api.js";
import { showBackground } from "./map/background.js";
import { Compare } from "./panel/compare.js";
import { Corners } from "./panel/corners.js";
import { byId, element, iconButton } from "./dom.js";
import { Drive } from "./map/drive.js";
import { acceptFiles } from "./map/drop.js";
import { ErrorLayer } from "./map/errors.js";
import { showFacts } from "./panel/facts.js";
import { Files } from "./panel/files.js";
import { Layers } from "./map/layers.js";
import { Live } from "./server/live.js";
import { createMap, zoomButtons } from "./map/view.js";
import { Plan } from "./server/plan.js";
import { Measured } from "./panel/measured.js";
import { Requirement } from "./panel/requirement.js";
import { RouteLayer } from "./map/route.js";
import { Runs } from "./panel/runs.js";
import { Settings } from "./panel/settings.js";
import { Swipe } from "./map/swipe.js";
import { createTabs } from "./panel/tabs.js";
import { Watch } from "./panel/watch.js";
import { Terrain } from "./map/terrain.js";
import { Tools } from "./map/tools.js";

/** @typedef {import("./types.js").Site} Site */

/** What is refused: the plan as it stands, and the last action. */
const refused = { plan: "", action: "" };

/** @param {string} sentence Empty when nothing is refused. @param {"plan"|"action"} what */
function refuse(sentence, what = "action") {
  refused[what] = sentence;
  byId("refusal").textContent = refused.action || refused.plan;
  byId("refusal").hidden = !(refused.action || refused.plan);
}

/** @param {Plan} plan @param {Site} site */
function showHistory(plan, site) {
  const undo = iconButton("undo", "Undo", () => plan.undo());
  const redo = iconButton("redo", "Redo", () => plan.redo());
  byId("history").append(undo, redo);
  plan.addEventListener("change", () => {
    for (const [button, title, word] of /** @type {const} */ ([[undo, plan.undoTitle, "Undo"], [redo, plan.redoTitle, "Redo"]])) {
      button.disabled = title === null;
      button.title = title ? `${word}: ${title}` : word;
      button.setAttribute("aria-label", button.title);
    }
    byId("saved").textContent = `Stored in ${site.folder}`;
    byId("saved").title = byId("saved").textContent ?? "";
  });
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
    if (/** @type {HTMLElement} */ (event.target).closest("input:not([type=checkbox]):not([type=range])")) return;
    event.preventDefault();
    if (event.shiftKey) plan.redo();
    else plan.undo();
  });
}

/** @param {string} sentence What the user should know and can close. @param {Node[]} buttons */
function notify(sentence, ...buttons) {
  const close = element("button", { type: "button", class: "quiet", text: "Close", onclick: () => (byId("notice").hidden = true) });
  byId("notice").replaceChildren(element("p", { text: sentence }), element("div", { class: "row" }, ...buttons, close));
  byId("notice").hidden = !sentence;
}

/** @param {Plan} plan @param {Site} site Offer the drawn plan where its mission has changed. */
function offerDrawn(plan, site) {
  const show = element("button", { type: "button", id: "show-drawn", text: "Show the drawn plan", onclick: () => plan.undo().then(() => (byId("notice").hidden = true)) });
  if (site.notice) notify(site.notice, show);
}

/** @param {any} map @param {number[]} extent */
function zoomTo(map, extent) {
  const isWide = byId("stage").clientWidth > 760;
  map.getView().fit(extent, { padding: isWide ? [56, 290, 60, 80] : [64, 24, 48, 24] });
}

/** @param {any} map @param {Plan} plan @param {Site} site */
function fitter(map, plan, site) {
  return () => {
    const places = plan.document.areas.flat(2);
    const xs = places.map(([x]) => x), ys = places.map(([, y]) => y);
    zoomTo(map, places.length ? [least(xs), least(ys), -least(xs.map((x) => -x)), -least(ys.map((y) => -y))] : site.tiles.extent);
  };
}

/** @param {number[]} values Any number of them; arguments of a function are limited. */
const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);

/** @param {any} map @returns {() => import("./types.js").Place[]} */
function squareInView(map) {
  return () => {
    const [x, y] = map.getView().getCenter().map(Math.round);
    const half = Math.round(0.2 * Math.min(...map.getSize()) * map.getView().getResolution());
    return [[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]];
  };
}

/** @param {() => void} openFile @param {Drive} drive */
function addMapButtons(openFile, drive) {
  const open = iconButton("open", "Open an outline, a raster or points", openFile);
  const show = iconButton("drive", "The drive in time, with its elevation", () => {
    drive.open(!drive.isOpen);
    show.setAttribute("aria-pressed", String(drive.isOpen));
  });
  show.id = "show-drive";
  show.setAttribute("aria-pressed", "false");
  byId("tools").append(element("hr"), open, show);
}

/** @param {any} map What tests and benchmarks ask of the map. @param {Plan} plan */
function expose(map, plan) {
  /** @type {any} */ (globalThis).firnlineDesk = {
    pixelOf: (/** @type {number} */ x, /** @type {number} */ y) => {
      const [left, top] = map.getPixelFromCoordinate([x, y]);
      const box = byId("map").getBoundingClientRect();
      return [left + box.left, top + box.top];
    },
    resolution: () => map.getView().getResolution(),
    view: () => ({ centre: map.getView().getCenter(), resolution: map.getView().getResolution() }),
    corner: () => plan.document.areas[0][0].toSorted((a, b) => b[0] - b[1] - (a[0] - a[1]))[0],
    map,
  };
}

async function begin() {
  /** @type {[Site, any]} */
  const [site, stored] = await Promise.all([get("/api/site"), get("/api/plan")]);
  byId("hint").textContent = "";
  byId("name").textContent = site.name;
  byId("crs").textContent = `${site.crs.name} · ${site.terrain}`;
  document.title = `${site.name} · firnline desk`;
  const map = createMap(site);
  const plan = new Plan();
  expose(map, plan);
  const live = new Live(plan);
  const route = new RouteLayer();
  const errors = new ErrorLayer(map.getView().getProjection());
  const terrain = new Terrain(map, site);
  const tools = new Tools(map, plan, site.grid_per_ground);
  for (const layer of [terrain.relief, terrain.slope, errors.layer, terrain.contours, route.layer, tools.layer]) map.addLayer(layer);
  const fit = fitter(map, plan, site);
  byId("tools").append(...zoomButtons(map, fit));
  const metres = (/** @type {number} */ value) => `${value < 10 ? value.toPrecision(2) : value.toFixed(0)} m`;
  const swipe = new Swipe(map);
  const layers = new Layers(map, [
    { name: "route", title: "Route", layer: route.layer },
    { name: "error", title: "Predicted error", layer: errors.layer, isPicture: true, legend: () => errors.shown?.image ? { title: "Predicted standard deviation", colours: errors.shown.colours, low: "0 m", high: `${metres(errors.shown.top_m)} or more` } : null },
    { name: "contours", title: "Contours", layer: terrain.contours },
    { name: "slope", title: "Slope", layer: terrain.slope, isPicture: true, legend: () => ({ title: "Slope", colours: site.slope_colours, low: "0°", high: `${site.largest_slope_deg}° or more` }) },
    { name: "relief", title: "Terrain", layer: terrain.relief, isPicture: true, isBase: true, legend: () => ({ title: "Elevation", colours: site.height_colours, low: metres(terrain.style.low_m), high: metres(terrain.style.high_m) }) },
  ], swipe);
  if (site.background) showBackground(map, layers, site.background);
  terrain.events.addEventListener("change", () => layers.legends());
  const corners = new Corners(plan, tools, squareInView(map), notify);
  const settings = element("div"), requirement = element("div"), runs = element("div");
  const compare = new Compare(plan, map, layers);
  const files = new Files(plan, refuse);
  const measured = new Measured(plan, map, layers, refuse);
  const watch = new Watch(map, layers, site.name);
  const drive = new Drive(() => byId("show-drive").click());
  map.addLayer(drive.layer);
  createTabs([
    { name: "settings", title: "Survey", page: settings },
    { name: "shapes", title: "Shapes", page: corners.page },
    { name: "require", title: "Require", page: requirement },
    { name: "compare", title: "Compare", page: compare.page },
    { name: "runs", title: "Run", page: runs },
    { name: "measured", title: "Measure", page: measured.page },
    { name: "watch", title: "Drive", page: watch.part },
    { name: "files", title: "Files", page: files.page },
  ]);
  showHistory(plan, site);
  listen(plan, live, route, errors, layers);
  live.addEventListener("route", (event) => {
    files.command.textContent = /** @type {CustomEvent} */ (event).detail.command;
    drive.refresh();
  });
  const openFile = acceptFiles(map, plan, layers, (file) => measured.take("points", file), refuse, (extent) => zoomTo(map, extent));
  addMapButtons(openFile, drive);
  await plan.load(Promise.resolve(stored));
  offerDrawn(plan, site);
  fit();
  document.documentElement.dataset.ready = "yes";
  const fields = await get("/api/fields");
  settings.append(new Settings(plan, fields).page);
  files.offer(fields);
  requirement.append(new Requirement(plan, fields).page);
  const run = new Runs(plan, fields, map, layers, refuse);
  runs.append(run.page);
  document.documentElement.dataset.forms = "yes";
  run.show();
  compare.show();
}

/** @param {Plan} plan @param {Live} live @param {RouteLayer} route @param {ErrorLayer} errors @param {Layers} layers */
function listen(plan, live, route, errors, layers) {
  const state = document.documentElement.dataset;
  plan.addEventListener("change", () => refuse(""));
  plan.addEventListener("refused", (event) => refuse(/** @type {CustomEvent} */ (event).detail));
  live.addEventListener("route", (event) => {
    const found = /** @type {CustomEvent} */ (event).detail;
    refuse("", "plan");
    route.show(found);
    showFacts(found);
    state.route = `${found.revision}${found.is_provisional ? "~" : ""}`;
  });
  live.addEventListener("error", (event) => {
    const found = /** @type {CustomEvent} */ (event).detail;
    errors.show(found);
    layers.legends();
    state.error = found ? `${plan.revision} ${found.detail}${found.is_provisional ? "~" : ""}` : `${plan.revision} none`;
  });
  live.addEventListener("refused", (event) => {
    refuse(/** @type {CustomEvent} */ (event).detail, "plan");
    route.show(null);
    showFacts(null);
    errors.show(null);
    layers.legends();
    state.route = `${plan.revision} refused`;
  });
}

begin().catch((error) => {
  byId("hint").textContent = "";
  refuse(error.message);
  byId("pages").append(element("p", { class: "note", text: "The desk could not be opened." }));
});
