// Files of the plan to take along, and the command that makes the same plan.
import { element } from "../dom.js";

/** @type {[string, [string, string][]][]} */
const GROUPS = [
  ["For autopilots", [[".plan", "QGroundControl mission"], [".waypoints", "Mission Planner waypoints"]]],
  ["For GPS and maps", [[".gpx", "GPX"], [".kml", "KML"], [".kmz", "KMZ"], [".geojson", "GeoJSON"], [".gpkg", "GeoPackage"], [".csv", "CSV"], [".wkt", "WKT"]]],
  ["For print and GIS", [[".pdf", "Plan sheets, PDF"], [".qgz", "QGIS project"], ["sigma.tif", "Predicted error, GeoTIFF"], ["area.gpkg", "Area, GeoPackage"], ["area.kml", "Area, KML"]]],
  ["Stakes and checkpoints", [["points.csv", "Points, CSV"], ["points.gpx", "Points, GPX"], ["points.gpkg", "Points, GeoPackage"]]],
  ["For firnline", [["mission.zip", "Mission file with its data"]]],
];

export class Files {
  /** @param {(sentence: string) => void} refuse */
  constructor(refuse) {
    this.refuse = refuse;
    this.command = element("pre", { class: "command", id: "command", tabindex: "0", "aria-label": "The same command" });
    const groups = GROUPS.flatMap(([title, kinds]) => [element("h2", { text: title }), element("div", { class: "row" }, ...kinds.map(([kind, name]) => this.#button(kind, name)))]);
    this.page = element("div", {}, ...groups,
      element("h2", { text: "The same command" }), this.command);
  }

  /** @param {string} kind @param {string} name */
  #button(kind, name) {
    return element("button", { type: "button", text: name, "data-kind": kind, onclick: () => this.#save(kind) });
  }

  /** @param {string} kind */
  async #save(kind) {
    const answer = await fetch(`/api/export/${kind}`).catch(() => null);
    if (!answer) return this.refuse("The server of the desk does not answer; start firnline desk again. The plan is stored.");
    if (!answer.ok) return this.refuse((await answer.json()).error);
    const name = /filename="([^"]+)"/.exec(answer.headers.get("content-disposition") ?? "")?.[1] ?? `plan${kind}`;
    const place = URL.createObjectURL(await answer.blob());
    element("a", { href: place, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(place), 10_000);
    return this.refuse("");
  }
}
