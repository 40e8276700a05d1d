// Files of the plan to take along, and the command that makes the same plan.
import { element } from "../dom.js";
import { Working } from "./working.js";

/** @type {[string, [string, string][]][]} */
const GROUPS = [
  ["For autopilots", [[".plan", "QGroundControl mission"], [".waypoints", "Mission Planner waypoints"]]],
  ["For GPS and maps", [[".gpx", "GPX"], [".kml", "KML"], [".kmz", "KMZ"], [".geojson", "GeoJSON"], [".gpkg", "GeoPackage"], [".csv", "CSV"], [".wkt", "WKT"]]],
  ["For print and GIS", [[".pdf", "Plan sheets, PDF"], [".qgz", "QGIS project"], ["sigma.tif", "Predicted error, GeoTIFF"], ["area.gpkg", "Area, GeoPackage"], ["area.kml", "Area, KML"]]],
  ["For firnline", [["mission.zip", "Mission file with its data"]]],
];

export class Files {
  /** @param {(sentence: string) => void} refuse @param {(paths: number[][][]) => void} showDriven */
  constructor(refuse, showDriven) {
    this.refuse = refuse;
    this.command = element("pre", { class: "command", id: "command", tabindex: "0", "aria-label": "The same command" });
    this.run = new Working("mission", "Run the mission", (event) => this.#follow(event, showDriven));
    this.result = element("div", { class: "stack", id: "mission-result", "aria-live": "polite" });
    const groups = GROUPS.flatMap(([title, kinds]) => [element("h2", { text: title }), element("div", { class: "row" }, ...kinds.map(([kind, name]) => this.#button(kind, name)))]);
    this.page = element("div", {}, ...groups,
      element("h2", { text: "The same command" }), this.command,
      element("h2", { text: "Simulate the survey" }),
      element("p", { class: "note", text: "Drives the plan over terrain that is drawn about the prior, with sensors of the default rover, and scores the map." }),
      this.run.part, this.result);
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

  /** @param {any} event @param {(paths: number[][][]) => void} showDriven */
  #follow(event, showDriven) {
    if (event.kind === "driven") showDriven(event.paths);
    if (event.kind !== "done") return;
    const report = element("a", { href: event.report, target: "_blank", rel: "noopener", text: "Open the report" });
    this.result.replaceChildren(element("p", { text: `RMSE ${event.rmse_m.toFixed(2)} m. ${event.verdict}` }), ...event.claims.map((/** @type {string} */ text) => element("p", { class: "note", text })), element("p", {}, report), element("p", { class: "small", text: event.run }));
  }
}
