// Comparing: the curve of error against swaths, and plans that were set aside.
import { get, post, Refusal } from "../server/api.js";
import { chart, pathOf, svg } from "../chart.js";
import { element } from "../dom.js";
import { lineLayer, showPicture } from "../map/overlays.js";
import { Working } from "./working.js";

/** @typedef {import("../server/plan.js").Plan} Plan */

export class Compare {
  /** @param {Plan} plan @param {any} map @param {import("../map/layers.js").Layers} layers */
  constructor(plan, map, layers) {
    this.plan = plan;
    this.map = map;
    this.layers = layers;
    this.differences = element("div", { id: "differences", "aria-live": "polite" });
    this.notes = /** @type {HTMLTextAreaElement} */ (element("textarea", { id: "notes", rows: "4", maxlength: "10000", onchange: () => this.#note() }));
    /** @type {any[]} */
    this.points = [];
    this.working = new Working("curve", "Compute the curve", (event) => this.#point(event));
    this.curve = element("div");
    this.table = element("div", { "aria-live": "polite" });
    const name = /** @type {HTMLInputElement} */ (element("input", { type: "text", id: "variant-name", maxlength: "80", placeholder: "Name of the variant" }));
    const add = element("button", { type: "button", text: "Set aside", id: "add-variant", onclick: () => this.#add(name.value).then((isDone) => isDone && (name.value = "")) });
    this.page = element("div", {},
      element("h2", { text: "Error against swaths" }), this.curve, this.working.part,
      element("h2", { text: "Variants" }),
      element("div", { class: "row" }, element("label", { for: "variant-name", class: "hidden", text: "Name of the variant" }), name, add),
      this.table, this.differences,
      element("h2", {}, element("label", { for: "notes", text: "Notes on this plan" })), this.notes);
    this.shown = "";
    plan.addEventListener("change", () => this.#clear());
  }

  /** Show the plans that are set aside, where they have changed. */
  async show() {
    const names = JSON.stringify(this.plan.variants);
    if (names === this.shown) return;
    this.shown = names;
    this.#rows((await get("/api/variants")).variants);
  }

  #clear() {
    this.points = [];
    this.curve.replaceChildren();
    if (document.activeElement !== this.notes) this.notes.value = this.plan.document.notes;
    if (this.differences.childElementCount) this.#end();
    this.show();
  }

  #note() {
    const notes = this.notes.value;
    if (notes !== this.plan.document.notes) this.plan.edit("Write a note", (document) => void (document.notes = notes));
  }

  /** @param {number} index Show a variant beside the plan: differences as a table, errors and route on the map. */
  async #beside(index) {
    try {
      const found = await get(`/api/variants/${index}/beside`);
      this.#end();
      this.#table(found);
      this.layers.add({ name: "beside-route", title: `Route of ${found.name}`, layer: lineLayer(found.lines, "#1d2a35", [8, 6]) });
      this.map.addLayer(this.layers.entries[0].layer);
      if (!found.error || !found.error_of_other) return;
      const ends = ["0 m", `${found.error.top_m} m or more`];
      showPicture(this.map, this.layers, "beside-other", `Error of ${found.name}`, { ...found.error_of_other, ends });
      showPicture(this.map, this.layers, "beside-this", "Error of this plan", { ...found.error, ends });
      this.layers.swipe.compare("beside-this", "beside-other");
    } catch (error) {
      this.plan.dispatchEvent(new CustomEvent("refused", { detail: error instanceof Error ? error.message : String(error) }));
    }
  }

  /** @param {{name: string, rows: string[][]}} found */
  #table({ name, rows }) {
    const head = element("tr", {}, ...["", "This plan", name, "Difference"].map((text) => element("th", { scope: "col", text })));
    const cells = rows.map(([title, ...texts]) => element("tr", {}, element("th", { scope: "row", text: title }), ...texts.map((text) => element("td", { text }))));
    this.differences.replaceChildren(element("h2", { text: `This plan and ${name}` }),
      element("table", { "aria-label": "Differences" }, element("thead", {}, head), element("tbody", {}, ...cells)),
      element("p", { class: "note", text: "On the map: this plan to the left of the line, the variant to its right; its route is dashed." }),
      element("button", { type: "button", text: "End the comparison", id: "end-beside", onclick: () => this.#end() }));
  }

  #end() {
    this.differences.replaceChildren();
    if (this.layers.entries.some((entry) => entry.name === "beside-this")) this.layers.swipe.end();
    for (const name of ["beside-route", "beside-this", "beside-other"]) this.layers.remove(name);
  }

  /** @param {any} event */
  #point(event) {
    if (event.kind === "stage") this.points = [];
    if (event.kind !== "point") return;
    if (event.done === 1) this.points = [];
    this.points.push(event);
    this.points.sort((a, b) => a.swaths - b.swaths);
    this.#draw();
  }

  #draw() {
    const swaths = this.points.map((point) => point.swaths), errors = this.points.map((point) => point.rmse_m);
    const axes = chart({ title: "Predicted RMSE against the number of swaths", xTitle: "swaths", yTitle: "RMSE [m]", xs: [0, Math.max(...swaths) * 1.04], ys: [0, Math.max(...errors) * 1.08] });
    axes.picture.append(svg("path", { d: pathOf(this.points.map((point) => [axes.x(point.swaths), axes.y(point.rmse_m)])), class: "curve" }));
    for (const point of this.points) {
      const dot = svg("circle", { cx: axes.x(point.swaths), cy: axes.y(point.rmse_m), r: point.is_chosen ? 7 : 6, class: point.is_chosen ? "dot chosen" : "dot" });
      dot.addEventListener("click", () => this.#useSwaths(point.swaths));
      dot.append(svg("title", {}, `${point.swaths} swaths: ${point.rmse_m.toFixed(2)} m, ${(point.length_m / 1000).toFixed(2)} km`));
      axes.picture.append(dot);
    }
    const rows = this.points.map((point) => element("tr", {}, element("td", { class: "number", text: String(point.swaths) }), element("td", { class: "number", text: `${point.rmse_m.toFixed(2)} m` }), element("td", { class: "number", text: `${(point.length_m / 1000).toFixed(2)} km` }), element("td", {}, this.#use(point.swaths))));
    const head = element("tr", {}, ...["Swaths", "RMSE", "Length", "Plan"].map((text) => element("th", { scope: "col", class: "number", text })));
    this.curve.replaceChildren(axes.picture, element("details", { class: "more", open: true }, element("summary", { text: "As a table" }), element("table", { "aria-label": "Error against swaths" }, element("thead", {}, head), element("tbody", {}, ...rows))));
  }

  /** @param {number} n */
  #use(n) {
    return element("button", { type: "button", class: "quiet", text: "Use", "aria-label": `Use ${n} swaths`, onclick: () => this.#useSwaths(n) });
  }

  /** @param {number} n */
  #useSwaths(n) {
    return this.plan.edit(`Use ${n} swaths`, (document) => {
      for (const size of ["spacing_m", "budget_m", "rmse_m"]) delete document.planner[size];
      document.planner.swaths = n;
    });
  }

  /** @param {string} name */
  async #add(name) {
    try {
      await post("/api/variants", { name });
      this.shown = "";
      await this.plan.load();
      return true;
    } catch (error) {
      this.plan.dispatchEvent(new CustomEvent("refused", { detail: error instanceof Refusal ? error.message : String(error) }));
      return false;
    }
  }

  /** @param {any[]} variants */
  #rows(variants) {
    if (!variants.length) return this.table.replaceChildren(element("p", { class: "note", text: "Set a plan aside to compare it with others." }));
    const cells = (/** @type {any} */ variant) => variant.error
      ? [element("td", { colspan: "3", text: variant.error })]
      : ["length_m", "time_s", "rmse_m"].map((name) => element("td", { class: "number", text: variant.facts[name] ?? "–" }));
    const rows = variants.map((variant, index) => {
      const show = () => this.plan.edit(`Show ${variant.name}`, (document) => void Object.assign(document, variant.document));
      const remove = () => fetch(`/api/variants/${index}`, { method: "DELETE" }).then(() => this.plan.load());
      return element("tr", {}, element("th", { scope: "row", text: variant.name }), ...cells(variant), element("td", { class: "row" },
        element("button", { type: "button", class: "quiet", text: "Beside", "aria-label": `Show ${variant.name} beside this plan`, disabled: Boolean(variant.error), onclick: () => this.#beside(index) }),
        element("button", { type: "button", class: "quiet", text: "Show", "aria-label": `Show ${variant.name}`, onclick: show }),
        element("button", { type: "button", class: "quiet", text: "−", "aria-label": `Remove ${variant.name}`, onclick: remove })));
    });
    const head = element("tr", {}, ...["Variant", "Length", "Time", "RMSE", "Plan"].map((text) => element("th", { scope: "col", text })));
    return this.table.replaceChildren(element("table", { id: "variants", "aria-label": "Variants" }, element("thead", {}, head), element("tbody", {}, ...rows)));
  }
}
