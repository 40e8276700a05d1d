// Comparing: the curve of error against swaths, and plans that were set aside.
import { get, post, Refusal } from "../server/api.js";
import { chart, pathOf, svg } from "../chart.js";
import { element } from "../dom.js";
import { Working } from "./working.js";

/** @typedef {import("../server/plan.js").Plan} Plan */

export class Compare {
  /** @param {Plan} plan */
  constructor(plan) {
    this.plan = plan;
    /** @type {any[]} */
    this.points = [];
    this.working = new Working("curve", "Compute the curve", (event) => this.#point(event));
    this.curve = element("div");
    this.table = element("div", { "aria-live": "polite" });
    const name = /** @type {HTMLInputElement} */ (element("input", { type: "text", id: "variant-name", maxlength: "80", placeholder: "Name of the variant" }));
    const add = element("button", { type: "button", text: "Set aside", id: "add-variant", onclick: () => this.#add(name.value) });
    this.page = element("div", {},
      element("h2", { text: "Error against swaths" }), this.curve, this.working.part,
      element("h2", { text: "Variants" }),
      element("div", { class: "row" }, element("label", { for: "variant-name", class: "hidden", text: "Name of the variant" }), name, add),
      this.table);
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
    this.show();
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
      const dot = svg("circle", { cx: axes.x(point.swaths), cy: axes.y(point.rmse_m), r: point.is_chosen ? 6 : 4, class: point.is_chosen ? "dot chosen" : "dot" });
      dot.append(svg("title", {}, `${point.swaths} swaths: ${point.rmse_m.toFixed(2)} m, ${(point.length_m / 1000).toFixed(2)} km`));
      axes.picture.append(dot);
    }
    const rows = this.points.map((point) => element("tr", {}, element("td", { class: "number", text: String(point.swaths) }), element("td", { class: "number", text: `${point.rmse_m.toFixed(2)} m` }), element("td", { class: "number", text: `${(point.length_m / 1000).toFixed(2)} km` }), element("td", {}, this.#use(point.swaths))));
    const head = element("tr", {}, ...["Swaths", "RMSE", "Length", "Plan"].map((text) => element("th", { scope: "col", class: "number", text })));
    this.curve.replaceChildren(axes.picture, element("details", { class: "more", open: true }, element("summary", { text: "As a table" }), element("table", { "aria-label": "Error against swaths" }, element("thead", {}, head), element("tbody", {}, ...rows))));
  }

  /** @param {number} n */
  #use(n) {
    const use = () => this.plan.edit(`Use ${n} swaths`, (document) => {
      for (const size of ["spacing_m", "budget_m", "rmse_m"]) delete document.planner[size];
      document.planner.swaths = n;
    });
    return element("button", { type: "button", class: "quiet", text: "Use", "aria-label": `Use ${n} swaths`, onclick: use });
  }

  /** @param {string} name */
  async #add(name) {
    try {
      await post("/api/variants", { name });
      this.shown = "";
      await this.plan.load();
    } catch (error) {
      this.plan.dispatchEvent(new CustomEvent("refused", { detail: error instanceof Refusal ? error.message : String(error) }));
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
        element("button", { type: "button", class: "quiet", text: "Show", "aria-label": `Show ${variant.name}`, onclick: show }),
        element("button", { type: "button", class: "quiet", text: "−", "aria-label": `Remove ${variant.name}`, onclick: remove })));
    });
    const head = element("tr", {}, ...["Variant", "Length", "Time", "RMSE", "Plan"].map((text) => element("th", { scope: "col", text })));
    return this.table.replaceChildren(element("table", { id: "variants", "aria-label": "Variants" }, element("thead", {}, head), element("tbody", {}, ...rows)));
  }
}
