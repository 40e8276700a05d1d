// Files of the plan to take along, and the command that makes the same plan.
import { element } from "../dom.js";
import { fieldRow } from "./form.js";

/** @type {[string, [string, string][]][]} */
const GROUPS = [
  ["For autopilots", [[".plan", "QGroundControl mission"], [".waypoints", "Mission Planner waypoints"]]],
  ["For GPS and maps", [[".gpx", "GPX"], [".kml", "KML"], [".kmz", "KMZ"], [".geojson", "GeoJSON"], [".gpkg", "GeoPackage"], [".csv", "CSV"], [".wkt", "WKT"]]],
  ["For print and GIS", [[".pdf", "Plan sheets, PDF"], [".qgz", "QGIS project"], ["sigma.tif", "Predicted error, GeoTIFF"], ["area.gpkg", "Area, GeoPackage"], ["area.kml", "Area, KML"]]],
  ["Stakes and checkpoints", [["points.csv", "Points, CSV"], ["points.gpx", "Points, GPX"], ["points.gpkg", "Points, GeoPackage"]]],
  ["For firnline", [["mission.zip", "Mission file with its data"], ["desk.zip", "This plan for a desk elsewhere"]]],
];

export class Files {
  /** @param {import("../server/plan.js").Plan} plan @param {(sentence: string) => void} refuse */
  constructor(plan, refuse) {
    this.plan = plan;
    this.refuse = refuse;
    /** @type {Record<string, any>} What a mission is made for. */
    this.mission = {};
    this.choices = element("div");
    this.command = element("pre", { class: "command", id: "command", tabindex: "0", "aria-label": "The same command" });
    const groups = GROUPS.flatMap(([title, kinds], index) => [element("h2", { text: title }), ...(index ? [] : [this.choices]), element("div", { class: "row" }, ...kinds.map(([kind, name]) => this.#button(kind, name)))]);
    this.page = element("div", {}, ...groups,
      element("h2", { text: "The same command" }), this.command);
  }

  /** Offer the choices of a mission; its speed is at first that of the rover. @param {import("../types.js").Fields} fields */
  offer(fields) {
    const speed = fields.rover.find((field) => field.name === "speed_m_s");
    const about = /** @type {[import("../types.js").Field, string][]} */ ([
      [{ name: "autopilot", help: "For which the mission is written.", default: "px4", kind: "choice", choices: ["px4", "ardupilot"] }, "Autopilot"],
      [{ name: "speed_m_s", help: "Speed that the mission sets; without one, that of the rover of the plan.", default: speed?.default, kind: "number", choices: [] }, "Speed"],
      [{ name: "returns", help: "End the mission with a return to launch, straight to the start.", default: false, kind: "boolean", choices: [] }, "Return to launch"],
    ]);
    const row = (/** @type {[import("../types.js").Field, string]} */ [field, title]) => fieldRow("mission", field, undefined, (value) => void (this.mission[field.name] = value), title);
    this.choices.append(...about.map(row));
    this.speed = () => this.mission.speed_m_s ?? this.plan.document.rover.speed_m_s ?? speed?.default;
  }

  /** @param {string} kind Return the address of a file. */
  #address(kind) {
    if (![".plan", ".waypoints"].includes(kind)) return `/api/export/${kind}`;
    const given = Object.entries({ ...this.mission, speed_m_s: this.speed?.() }).filter(([, value]) => value !== undefined);
    return `/api/export/${kind}?${new URLSearchParams(given.map(([name, value]) => [name, String(value)]))}`;
  }

  /** @param {string} kind @param {string} name */
  #button(kind, name) {
    return element("button", { type: "button", text: name, "data-kind": kind, onclick: () => this.#save(kind) });
  }

  /** @param {string} kind */
  async #save(kind) {
    const answer = await fetch(this.#address(kind)).catch(() => null);
    if (!answer) return this.refuse("The server of the desk does not answer; start firnline desk again. The plan is stored.");
    if (!answer.ok) return this.refuse((await answer.json()).error);
    const name = /filename="([^"]+)"/.exec(answer.headers.get("content-disposition") ?? "")?.[1] ?? `plan${kind}`;
    const place = URL.createObjectURL(await answer.blob());
    element("a", { href: place, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(place), 10_000);
    return this.refuse("");
  }
}
