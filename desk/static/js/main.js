// The page of the desk: a map first, one panel beside it. Everything that is shown was computed by the server.
import { get } from "./api.js";
import { Corners } from "./corners.js";
import { byId, element, iconButton } from "./dom.js";
import { ErrorLayer } from "./errors.js";
import { showFacts } from "./facts.js";
import { Layers } from "./layers.js";
import { Live } from "./live.js";
import { createMap, terrainLayer, zoomButtons } from "./map.js";
import { Plan } from "./plan.js";
import { RouteLayer } from "./route.js";
import { Settings } from "./settings.js";
import { createTabs } from "./tabs.js";
import { Tools } from "./tools.js";

/** @typedef {import("./types.js").Site} Site */

/** @param {string} sentence */
function refuse(sentence) {
  byId("refusal").textContent = sentence;
  byId("refusal").hidden = sentence === "";
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

/** @param {any} map @param {Plan} plan @param {Site} site */
function fitter(map, plan, site) {
  return () => {
    const places = plan.document.areas.flat(2);
    const xs = places.map(([x]) => x), ys = places.map(([, y]) => y);
    const extent = places.length ? [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)] : site.tiles.extent;
    const top = byId("stage").clientWidth > 760 ? 56 : 20;
    map.getView().fit(extent, { padding: [top, 70, 60, 70] });
  };
}

/** @param {any} map @returns {() => import("./types.js").Place[]} */
function squareInView(map) {
  return () => {
    const [x, y] = map.getView().getCenter().map(Math.round);
    const half = Math.round(0.2 * Math.min(...map.getSize()) * map.getView().getResolution());
    return [[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]];
  };
}

async function begin() {
  /** @type {Site} */
  const site = await get("/api/site");
  byId("name").textContent = site.name;
  byId("crs").textContent = `${site.crs.name} · ${site.terrain}`;
  document.title = `${site.name} · firnline desk`;
  const map = createMap(site);
  const plan = new Plan();
  const live = new Live(plan);
  const route = new RouteLayer();
  const errors = new ErrorLayer(map.getView().getProjection());
  const relief = terrainLayer(site, "relief", true), slope = terrainLayer(site, "slope", false), contours = terrainLayer(site, "contours", false);
  slope.setOpacity(0.6);
  const tools = new Tools(map, plan, site.grid_per_ground);
  for (const layer of [relief, slope, errors.layer, contours, route.layer, tools.layer]) map.addLayer(layer);
  const fit = fitter(map, plan, site);
  byId("tools").append(...zoomButtons(map, fit));
  const metres = (/** @type {number} */ value) => `${value < 10 ? value.toPrecision(2) : value.toFixed(0)} m`;
  const layers = new Layers([
    { name: "route", title: "Route", layer: route.layer },
    { name: "error", title: "Predicted error", layer: errors.layer, legend: () => errors.shown?.image ? { title: "Predicted standard deviation", colours: errors.shown.colours, low: "0 m", high: `${metres(errors.shown.top_m)} or more` } : null },
    { name: "contours", title: `Contours, ${site.contour_interval_m} m`, layer: contours },
    { name: "slope", title: "Slope", layer: slope, legend: () => ({ title: "Slope", colours: site.slope_colours, low: "0°", high: `${site.largest_slope_deg}° or more` }) },
    { name: "relief", title: "Terrain", layer: relief, legend: () => ({ title: "Elevation", colours: site.height_colours, low: metres(site.heights_m[0]), high: metres(site.heights_m[1]) }) },
  ]);
  const settings = new Settings(plan, site);
  const corners = new Corners(plan, tools, squareInView(map));
  createTabs([
    { name: "settings", title: "Survey", page: settings.page },
    { name: "shapes", title: "Shapes", page: corners.page },
  ]);
  showHistory(plan, site);
  listen(plan, live, route, errors, layers);
  await plan.load();
  fit();
  document.documentElement.dataset.ready = "yes";
}

/** @param {Plan} plan @param {Live} live @param {RouteLayer} route @param {ErrorLayer} errors @param {Layers} layers */
function listen(plan, live, route, errors, layers) {
  const state = document.documentElement.dataset;
  plan.addEventListener("refused", (event) => refuse(/** @type {CustomEvent} */ (event).detail));
  live.addEventListener("route", (event) => {
    const found = /** @type {CustomEvent} */ (event).detail;
    refuse("");
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
    refuse(/** @type {CustomEvent} */ (event).detail);
    route.show(null);
    showFacts(null);
    errors.show(null);
    layers.legends();
    state.route = `${plan.revision} refused`;
  });
}

begin().catch((error) => {
  refuse(error.message);
  byId("pages").append(element("p", { class: "note", text: "The desk could not be opened." }));
});
