// Requirement first: a class or an RMSE with a probability, and the cheapest plan that guarantees it.
import { element } from "../dom.js";
import { fieldRow } from "./form.js";
import { Working } from "./working.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
/** @typedef {import("../types.js").Fields} Fields */

export class Requirement {
  /** @param {Plan} plan @param {Fields} fields */
  constructor(plan, fields) {
    this.plan = plan;
    this.about = fields;
    this.working = new Working("guarantee", "Find the cheapest plan", (event) => this.#follow(event));
    this.fields = element("div");
    this.answer = element("div", { class: "stack", "aria-live": "polite" });
    this.page = element("div", {}, element("h2", { text: "Required error" }), this.fields, this.working.part, this.answer);
    plan.addEventListener("change", () => this.show());
    this.show();
  }

  show() {
    const focused = document.activeElement?.id;
    const given = this.plan.document.requirement;
    const rows = this.about.requirement.map((field) =>
      fieldRow("requirement", field, given[field.name], (value) =>
        this.plan.edit("Set the required error", (document) => {
          if (value === undefined) delete document.requirement[field.name];
          else document.requirement[field.name] = value;
        }), field.name === "require" ? "Class or RMSE in metres" : undefined));
    const [first, ...rest] = rows;
    this.fields.replaceChildren(first, ...rest.slice(0, 3), element("details", { class: "more", open: this.fields.querySelector("details")?.open ?? false }, element("summary", { text: "More assumptions" }), ...rest.slice(3)));
    if (focused && this.fields.querySelector(`#${CSS.escape(focused)}`)) document.getElementById(focused)?.focus();
  }

  /** @param {any} event */
  #follow(event) {
    if (event.kind !== "done") return this.answer.replaceChildren();
    const use = () => this.plan.edit("Use the guaranteed plan", (document) => void (document.planner = event.planner));
    const parts = [element("p", { text: event.sentence, id: "guarantee-sentence" }), element("pre", { class: "command", text: event.command, tabindex: "0", "aria-label": "The same command" })];
    if (event.holds) parts.push(element("div", { class: "row" }, element("button", { type: "button", text: "Use this plan", id: "use-guarantee", onclick: use })));
    return this.answer.replaceChildren(...parts);
  }
}
