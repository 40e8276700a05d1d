// Drawing tools: select and move, outline, hole, no-go zone, start, measure, remove.
import { byId, element, iconButton } from "../dom.js";
import { featuresOf, MARKS, placesOf, styleOf } from "./shapes.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
const ol = /** @type {any} */ (globalThis).ol;
/** Tools that mark points, and where the document holds them. */
const POINTS = /** @type {Record<string, string>} */ ({ start: "starts", stake: "stakes", checkpoint: "checkpoints" });
const NAMES = /** @type {Record<string, string>} */ ({ areas: "an area", no_go: "a no-go zone", starts: "a start", stakes: "a stake", checkpoints: "a checkpoint" });

/** @type {[any, string, string, string][]} */
const TOOLS = [
  ["select", "Select and move", "v", ""],
  ["area", "Draw an area", "a", "Click the corners of the area; double-click ends it, Escape gives it up."],
  ["hole", "Draw a hole in an area", "h", "Click the corners of the hole inside an area; double-click ends it."],
  ["no_go", "Draw a no-go zone", "n", "Click the corners of ground that no route may touch; double-click ends it."],
  ["start", "Mark a start", "s", "Click where a rover starts, inside the area."],
  ["stake", "Set a stake", "k", "Click where a stake is to be set and surveyed."],
  ["checkpoint", "Mark a checkpoint", "c", "Click where the map is to be checked by a height that it is not made from."],
  ["measure", "Measure a distance", "m", "Click along what you want to measure; double-click ends it."],
];

export class Tools {
  /** @param {any} map @param {Plan} plan @param {number} gridPerGround */
  constructor(map, plan, gridPerGround) {
    this.map = map;
    this.plan = plan;
    this.gridPerGround = gridPerGround;
    /** @type {string|null} */
    this.selected = null;
    this.source = new ol.source.Vector();
    const style = (/** @type {any} */ feature) => styleOf(feature, feature.getId() === this.selected);
    this.layer = new ol.layer.Vector({ source: this.source, style, zIndex: 20, updateWhileInteracting: true });
    this.sketch = new ol.source.Vector();
    this.events = new EventTarget();
    /** @type {any[]} */
    this.active = [];
    this.remove = iconButton("remove", "Remove what is selected (Delete)", () => this.removeSelected());
    this.remove.disabled = true;
    this.#buttons();
    map.on("singleclick", (/** @type {any} */ event) => this.tool === "select" && this.#selectAt(event.pixel));
    plan.addEventListener("change", () => this.show());
    document.addEventListener("keydown", (event) => this.#key(event));
    this.use("select");
  }

  /** Show the document. */
  show() {
    this.source.clear(true);
    this.source.addFeatures(featuresOf(this.plan.document));
    if (this.selected && !this.source.getFeatureById(this.selected)) this.select(null);
  }

  /** @param {string|null} id Of a feature, such as areas-0. */
  select(id) {
    this.selected = id;
    this.layer.changed();
    this.remove.disabled = id === null;
    this.events.dispatchEvent(new Event("select"));
  }

  /** @param {string} name */
  use(name) {
    this.tool = name;
    for (const interaction of this.active) this.map.removeInteraction(interaction);
    this.sketch.clear();
    this.active = name === "select" ? this.#moving() : [this.#drawing(name), new ol.interaction.Snap({ source: this.source })];
    for (const interaction of this.active) this.map.addInteraction(interaction);
    for (const button of byId("tools").querySelectorAll("[data-tool]"))
      button.setAttribute("aria-pressed", String(button.getAttribute("data-tool") === name));
    byId("hint").textContent = TOOLS.find(([tool]) => tool === name)?.[3] ?? "";
  }

  /** Remove what is selected. */
  removeSelected() {
    const [role, index] = (this.selected ?? "").split("-");
    if (!role) return;
    this.select(null);
    this.plan.edit(`Remove ${NAMES[role]}`, (document) => void (/** @type {any} */ (document)[role].splice(Number(index), 1)));
  }

  #buttons() {
    const buttons = TOOLS.map(([name, title, key]) => {
      const button = iconButton(name, `${title} (${key.toUpperCase()})`, () => this.use(name));
      button.dataset.tool = name;
      return button;
    });
    byId("tools").append(...buttons, element("hr"), this.remove, element("hr"));
  }

  #moving() {
    const modify = new ol.interaction.Modify({ source: this.source, pixelTolerance: 12 });
    /** @type {any[]} */
    let moved = [];
    modify.on("modifystart", (/** @type {any} */ event) => {
      const before = new Map(event.features.getArray().map((/** @type {any} */ f) => [f, f.getRevision()]));
      moved = [before];
    });
    modify.on("modifyend", (/** @type {any} */ event) => {
      const [before] = moved;
      const changed = event.features.getArray().filter((/** @type {any} */ f) => before?.get(f) !== f.getRevision());
      if (changed.length) this.#storeMoved(changed);
    });
    return [modify, new ol.interaction.Snap({ source: this.source })];
  }

  /** @param {any[]} features */
  #storeMoved(features) {
    const first = features[0].get("role");
    const title = first in MARKS ? `Move ${NAMES[first]}` : "Move a corner";
    const places = features.map((f) => [f.get("role"), f.get("index"), placesOf(f.getGeometry())]);
    this.plan.edit(title, (document) => {
      for (const [role, index, place] of places) /** @type {any} */ (document)[role][index] = place;
    });
  }

  /** @param {string} name */
  #drawing(name) {
    const kind = name in POINTS ? "Point" : name === "measure" ? "LineString" : "Polygon";
    const draw = new ol.interaction.Draw({ source: this.sketch, type: kind, stopClick: true });
    if (name === "measure") draw.on("drawstart", (/** @type {any} */ event) => this.#measure(event.feature));
    draw.on("drawend", (/** @type {any} */ event) => {
      if (name === "measure") return;
      this.#add(name, event.feature.getGeometry());
      if (!["stake", "checkpoint"].includes(name)) setTimeout(() => this.use("select"));
      else setTimeout(() => this.sketch.clear());
    });
    return draw;
  }

  /** @param {any} feature */
  #measure(feature) {
    this.sketch.clear();
    feature.getGeometry().on("change", () => {
      const length = feature.getGeometry().getLength() / this.gridPerGround;
      byId("hint").textContent = length < 1000 ? `${length.toFixed(1)} m on the ground` : `${(length / 1000).toFixed(3)} km on the ground`;
    });
  }

  /** @param {string} name @param {any} geometry */
  #add(name, geometry) {
    const places = placesOf(geometry);
    if (name in POINTS) return this.plan.edit(titleOf(name), (document) => void (/** @type {any} */ (document)[POINTS[name]].push(places)));
    if (name === "no_go") return this.plan.edit("Draw a no-go zone", (document) => void document.no_go.push(places));
    if (name === "area") return this.plan.edit("Draw an area", (document) => void document.areas.push(places));
    const around = this.source.getFeatures().find((/** @type {any} */ f) => f.get("role") === "areas" && f.getGeometry().intersectsCoordinate(geometry.getFirstCoordinate()));
    if (!around) {
      byId("hint").textContent = "A hole begins inside an area; draw it there.";
      return undefined;
    }
    return this.plan.edit("Draw a hole", (document) => void document.areas[around.get("index")].push(places[0]));
  }

  /** @param {number[]} pixel */
  #selectAt(pixel) {
    const options = { layerFilter: (/** @type {any} */ layer) => layer === this.layer, hitTolerance: 6 };
    const found = this.map.getFeaturesAtPixel(pixel, options);
    this.select(found.length ? found[0].getId() : null);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const target = /** @type {HTMLElement} */ (event.target);
    if (target.closest("input, select, textarea, dialog") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Escape") this.use("select");
    else if (event.key === "Delete") this.removeSelected();
    else {
      const tool = TOOLS.find(([, , key]) => key === event.key);
      if (tool) this.use(tool[0]);
    }
  }
}

/** @param {string} name Of a tool. */
function titleOf(name) {
  return TOOLS.find(([tool]) => tool === name)?.[1] ?? "";
}
