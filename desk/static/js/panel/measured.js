// Real measurements: take their files, make and score the map, propose the swath to drive next.
import { element } from "../dom.js";
import { lineLayer, pointLayer, showPicture } from "../map/overlays.js";
import { get, post } from "../server/api.js";
import { Working } from "./working.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
/** @typedef {{file: string, role: string, kind: string, places: number[][], lines: number[][][], n_points: number}} Taken */

const ROLES = /** @type {[string, string, string, string][]} */ ([
  ["points", "Measured points", "landmarks.gpkg, a GNSS or total-station table (CSV), LAS or PLY", "#7a3e9d"],
  ["checkpoints", "Checkpoints", "independent heights; the map is not made from them", "#0b6b50"],
  ["driven", "Driven route", "GeoJSON; without one the route of the plan counts as driven", "#1d2a35"],
]);

export class Measured {
  /** @param {Plan} plan @param {any} map @param {import("../map/layers.js").Layers} layers @param {(sentence: string) => void} refuse */
  constructor(plan, map, layers, refuse) {
    this.plan = plan;
    this.map = map;
    this.layers = layers;
    this.refuse = refuse;
    this.names = new Map(ROLES.map(([role]) => [role, element("span", { class: "small", id: `taken-${role}` })]));
    this.made = element("div", { class: "stack", id: "measured-result", "aria-live": "polite" });
    this.next = element("div", { class: "stack", id: "next-result", "aria-live": "polite" });
    const map_ = new Working("map", "Make the map", (event) => this.#mapped(event));
    const next = new Working("next", "Propose the next swath", (event) => this.#proposed(event));
    this.page = element("div", {},
      element("h2", { text: "Real measurements" }), ...ROLES.map((about) => this.#chooser(about)),
      element("h2", { text: "Map and score" }), map_.part, this.made,
      element("h2", { text: "Next swath" }),
      element("p", { class: "note", text: "Fits the terrain to what was measured, and finds the swath after which the required error is reached soonest. The requirement is that of the tab Require." }),
      next.part, this.next);
    this.shown = "";
    plan.addEventListener("change", () => this.show());
  }

  /** @param {[string, string, string, string]} about */
  #chooser([role, title, help]) {
    const input = element("input", { type: "file", id: `measured-${role}`, "aria-describedby": `measured-${role}-help`, onchange: (/** @type {any} */ event) => this.take(role, event.target.files[0]).then(() => (event.target.value = "")) });
    return element("div", { class: "taken" }, element("label", { for: `measured-${role}`, text: title }), input, element("span", { class: "small", id: `measured-${role}-help`, text: help }), this.names.get(role) ?? "");
  }

  /** @param {string} role @param {File|undefined} file */
  async take(role, file) {
    if (!file) return;
    try {
      const found = await post(`/api/measured/${role}?name=${encodeURIComponent(file.name)}`, file);
      this.refuse("");
      await this.plan.edit(`Take ${found.file}`, (document) => void (document.measured[role] = found.file));
    } catch (error) {
      this.refuse(error instanceof Error ? error.message : String(error));
    }
  }

  /** Show the files that the document names, where they have changed. */
  async show() {
    const named = JSON.stringify(this.plan.document.measured);
    if (named === this.shown) return;
    this.shown = named;
    const { files } = await get("/api/measured").catch(() => ({ files: [] }));
    for (const [role, title, , colour] of ROLES) {
      const taken = files.find((/** @type {Taken} */ one) => one.role === role);
      this.layers.remove(`measured-${role}`);
      const text = this.names.get(role);
      if (text) text.textContent = taken ? `${taken.file}${taken.n_points ? `, ${taken.n_points} points` : ""}` : "";
      if (taken) this.#draw(`measured-${role}`, title, taken.kind === "lines" ? lineLayer(taken.lines, colour) : pointLayer(taken.places, colour));
    }
  }

  /** @param {string} name @param {string} title @param {any} layer */
  #draw(name, title, layer) {
    this.layers.add({ name, title, layer });
    this.map.addLayer(layer);
  }

  /** @param {any} event */
  #mapped(event) {
    if (event.kind !== "done") return this.made.replaceChildren();
    showPicture(this.map, this.layers, "measured-sigma", "σ of the measured map", event.sigma);
    showPicture(this.map, this.layers, "measured-elevation", "Measured map", event.elevation);
    return this.made.replaceChildren(...event.sentences.map((/** @type {string} */ text) => element("p", { text })),
      element("p", { class: "small", text: `Written to ${event.folder}; the same by command:` }),
      element("pre", { class: "command", text: event.commands.join("\n"), tabindex: "0", "aria-label": "The same commands" }));
  }

  /** @param {any} event */
  #proposed(event) {
    if (event.kind !== "done") return this.next.replaceChildren();
    this.layers.remove("next-swath");
    if (event.lines.length) this.#draw("next-swath", "Next swath", lineLayer(event.lines, "#c2185b", [10, 6]));
    const file = event.file ? [element("p", { class: "small", text: `Stored as ${event.file} beside the measurements; firnline export writes it for autopilots.` })] : [];
    return this.next.replaceChildren(element("p", { text: event.sentence, id: "next-sentence" }), ...file);
  }
}
