// Simulated runs: start one and watch it, look at the maps of earlier ones, compare two.
import { element } from "../dom.js";
import { showPicture } from "../map/overlays.js";
import { get } from "../server/api.js";
import { fieldRow } from "./form.js";
import { Replay } from "./replay.js";
import { Working } from "./working.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
/** @typedef {import("../types.js").RunRow} RunRow */

const LAYERS = /** @type {[string, string][]} */ ([["error", "Error"], ["sigma", "σ"], ["elevation", "Elevation"], ["support", "Support"]]);

export class Runs {
  /**
   * @param {Plan} plan @param {import("../types.js").Fields} fields @param {any} map
   * @param {import("../map/layers.js").Layers} layers @param {(sentence: string) => void} refuse
   */
  constructor(plan, fields, map, layers, refuse) {
    this.plan = plan;
    this.about = fields;
    this.map = map;
    this.layers = layers;
    this.refuse = refuse;
    /** @type {RunRow[]} */
    this.rows = [];
    /** @type {string[]} */
    this.chosen = [];
    this.fields = element("div");
    this.replay = new Replay(map, layers, "replay", "Simulated drive");
    this.run = new Working("mission", "Run the mission", (event) => this.#follow(event, this.run));
    this.again = new Working("replay", "Show its drive", (event) => this.#follow(event, this.again));
    this.again.button.hidden = true;
    this.result = element("div", { class: "stack", id: "mission-result", "aria-live": "polite" });
    this.table = element("div", { id: "runs" });
    this.comparison = element("div", { id: "comparison", "aria-live": "polite" });
    this.page = element("div", {},
      element("h2", { text: "Simulate the survey" }),
      element("p", { class: "note", text: "Drives the plan over terrain that is drawn about the prior, maps it from what the rover measured, and scores the map. With images (vision) a run takes about as long as the drive." }),
      this.fields, this.run.part, this.again.part, this.replay.part, this.result,
      element("h2", { text: "Runs" }), this.table, this.comparison);
    plan.addEventListener("change", () => this.#settings());
    this.#settings();
  }

  #settings() {
    const focused = document.activeElement?.id;
    const given = this.plan.document.simulation;
    const rows = this.about.simulation.map((field) => fieldRow("simulation", field, given[field.name], (value) =>
      this.plan.edit("Set the simulation", (document) => {
        if (value === undefined) delete document.simulation[field.name];
        else document.simulation[field.name] = value;
      }), field.name === "fidelity" ? "Depth" : undefined));
    this.fields.replaceChildren(...rows);
    if (focused?.startsWith("simulation-")) document.getElementById(focused)?.focus();
  }

  /** @param {any} event @param {Working} working */
  #follow(event, working) {
    if (event.kind === "started") {
      this.shown = working;
      this.replay.clear();
    }
    if (working === this.shown) this.replay.take(event, working.running?.job);
    if (event.kind === "done" && working === this.run) this.#done(event);
  }

  /** @param {any} event */
  #done(event) {
    const report = element("a", { href: event.report, target: "_blank", rel: "noopener", text: "Open the report" });
    this.result.replaceChildren(
      element("p", { text: `RMSE ${event.rmse_m.toFixed(2)} m. ${event.verdict}` }),
      ...event.claims.map((/** @type {string} */ text) => element("p", { class: "note", text })),
      element("p", {}, report),
      element("p", { class: "note", text: "On the map: the estimated path is solid, the true one dashed; the ellipse about a rover holds it with 95 %." }),
      element("p", { class: "small", text: `QGIS project: ${event.project}` }));
    this.show();
  }

  async show() {
    this.rows = (await get("/api/runs").catch(() => ({ runs: [] }))).runs;
    this.chosen = this.chosen.filter((name) => this.rows.some((row) => row.name === name));
    const rows = this.rows.map((row) => this.#row(row));
    this.table.replaceChildren(...(rows.length ? rows : [element("p", { class: "note", text: "No run yet. Each run stays here with its maps." })]));
    this.#compare();
  }

  /** @param {RunRow} row */
  #row(row) {
    const compared = element("input", { type: "checkbox", id: `compare-${row.name}`, checked: this.chosen.includes(row.name), onchange: (/** @type {any} */ event) => this.#choose(row.name, event.target.checked) });
    const buttons = LAYERS.map(([layer, text]) => element("button", { type: "button", class: "quiet", text, "aria-label": `${text} of ${row.title} on the map`, onclick: () => this.#showLayer(row, layer) }));
    const drive = element("button", { type: "button", class: "quiet", text: "Drive", "aria-label": `Drive of ${row.title} in time`, onclick: () => this.#replay(row) });
    const report = row.has_report ? [element("a", { href: `/api/runs/${row.name}/report/index.html`, target: "_blank", rel: "noopener", text: "Report", "aria-label": `Report of ${row.title}` })] : [];
    return element("div", { class: "run" },
      element("div", { class: "layer" }, compared, element("label", { for: `compare-${row.name}`, text: row.title }), element("b", { text: row.facts.RMSE ?? "" })),
      row.error ? element("p", { class: "note", text: row.error }) : element("div", { class: "row" }, ...buttons, drive, ...report));
  }

  /** @param {RunRow} row */
  #replay(row) {
    this.again.about = { run: row.name };
    this.again.start();
    this.page.scrollIntoView();
  }

  /** @param {RunRow} row @param {string} layer */
  async #showLayer(row, layer) {
    await this.#picture(`/api/runs/${row.name}/layers/${layer}`, `run-${row.name}-${layer}`, row.title);
  }

  /** @param {string} address @param {string} name @param {string} of */
  async #picture(address, name, of) {
    try {
      const picture = await get(address);
      showPicture(this.map, this.layers, name, `${picture.title}: ${of}`, picture);
      return picture;
    } catch (error) {
      this.refuse(error instanceof Error ? error.message : String(error));
      return null;
    }
  }

  /** @param {string} name @param {boolean} isChosen At most two are compared. */
  #choose(name, isChosen) {
    this.chosen = [...this.chosen.filter((one) => one !== name), ...(isChosen ? [name] : [])].slice(-2);
    for (const row of this.rows) /** @type {any} */ (document.getElementById(`compare-${row.name}`)).checked = this.chosen.includes(row.name);
    this.#compare();
  }

  #compare() {
    const pair = this.chosen.flatMap((name) => this.rows.filter((row) => row.name === name));
    if (pair.length < 2) {
      this.comparison.replaceChildren(...(this.rows.length > 1 ? [element("p", { class: "note", text: "Tick two runs to compare them." })] : []));
      return;
    }
    const names = Object.keys(pair[0].facts);
    const rows = names.map((name) => element("tr", {}, element("th", { scope: "row", text: name }), ...pair.map((row) => element("td", { text: row.facts[name] ?? "–" }))));
    const head = element("tr", {}, element("td"), ...pair.map((row) => element("th", { scope: "col", text: row.title })));
    const difference = element("button", { type: "button", id: "show-difference", text: "Show the difference of the maps", onclick: () => this.#difference(pair) });
    this.comparison.replaceChildren(element("table", { "aria-label": "Two runs side by side" }, element("thead", {}, head), element("tbody", {}, ...rows)), difference, element("p", { class: "note", id: "difference" }));
  }

  /** @param {RunRow[]} pair */
  async #difference([one, other]) {
    const found = await this.#picture(`/api/runs/${one.name}/minus/${other.name}`, "run-difference", "first minus second run");
    const note = this.comparison.querySelector("#difference");
    if (found && note) note.textContent = `The maps differ by ${found.rms_m.toFixed(3)} m, root mean square.`;
  }
}
