// The page of settings: pattern, swaths or spacing, heading, rover, fleet.
import { element } from "../dom.js";
import { fieldRow, titleOf } from "./form.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
/** @typedef {import("../types.js").Fields} Fields */

const SIZES = ["swaths", "spacing_m", "budget_m", "rmse_m"];
const FIRST = {
  planner: ["heading_deg", "inset_share", "tie_lines", "start"],
  rover: ["max_pitch_deg", "max_roll_deg", "turn_radius_m", "battery_j", "speed_m_s"],
  fleet: ["rovers", "return_to_start", "separation_m"],
};
/** Fields that a number or a choice cannot hold. */
const LEFT_OUT = ["end_m", "candidates_deg"];

export class Settings {
  /** @param {Plan} plan @param {Fields} fields */
  constructor(plan, fields) {
    this.plan = plan;
    this.about = fields;
    this.page = element("div");
    plan.addEventListener("change", () => this.show());
    this.show();
  }

  /** Show the settings of the document; inputs stay where their fields are as before, and what is being typed stays too. */
  show() {
    const made = element("div", {}, ...this.#pattern(), ...this.#section("rover", "Rover"), ...this.#section("fleet", "Fleet"));
    if (idsOf(made) === idsOf(this.page)) {
      for (const input of inputsOf(made)) update(/** @type {HTMLInputElement} */ (this.page.querySelector(`#${CSS.escape(input.id)}`)), input);
      return;
    }
    const focused = document.activeElement?.id;
    const open = [...this.page.querySelectorAll("details")].map((details) => details.open);
    this.page.replaceChildren(...made.childNodes);
    this.page.querySelectorAll("details").forEach((details, index) => (details.open = open[index] ?? false));
    if (focused && this.page.querySelector(`#${CSS.escape(focused)}`)) document.getElementById(focused)?.focus();
  }

  get #planner() {
    return this.plan.document.planner;
  }

  #pattern() {
    const names = Object.keys(this.about.planner);
    const field = { name: "pattern", help: "How the swaths are laid over the area.", default: "lawnmower", kind: "choice", choices: names };
    const fields = this.about.planner[this.#planner.pattern] ?? [];
    const row = (/** @type {any} */ about) => this.#row("planner", about);
    const first = fields.filter((about) => FIRST.planner.includes(about.name));
    const rest = fields.filter((about) => ![...FIRST.planner, ...SIZES, ...LEFT_OUT].includes(about.name));
    return [
      element("h2", { text: "Pattern" }),
      fieldRow("planner", field, this.#planner.pattern, (value) => this.#usePattern(value)),
      ...this.#size(fields),
      ...first.map(row),
      ...(rest.length ? [more("More of the pattern", rest.map(row))] : []),
    ];
  }

  /** @param {import("../types.js").Field[]} fields */
  #size(fields) {
    const sizes = fields.filter((field) => SIZES.includes(field.name));
    const used = sizes.find((field) => this.#planner[field.name] !== undefined && this.#planner[field.name] !== null) ?? sizes[0];
    if (!used) return [];
    const by = { name: "size_by", help: "What decides how dense the swaths are.", default: used.name, kind: "choice", choices: sizes.map((field) => field.name) };
    const titled = fieldRow("planner", by, used.name, (name) => this.#useSize(name), "Size by");
    for (const option of titled.querySelectorAll("option")) option.textContent = titleOf(option.value).toLowerCase();
    return [titled, this.#row("planner", used)];
  }

  /** @param {"rover"|"fleet"} section @param {string} title */
  #section(section, title) {
    const fields = this.about[section].filter((field) => !LEFT_OUT.includes(field.name));
    const first = fields.filter((field) => FIRST[section].includes(field.name));
    const rest = fields.filter((field) => !FIRST[section].includes(field.name));
    const rows = (/** @type {any[]} */ some) => some.map((field) => this.#row(section, field));
    return [element("h2", { text: title }), ...rows(first), ...(rest.length ? [more(`More of the ${title.toLowerCase()}`, rows(rest))] : [])];
  }

  /** @param {"planner"|"rover"|"fleet"} section @param {import("../types.js").Field} field */
  #row(section, field) {
    return fieldRow(section, field, this.plan.document[section][field.name], (value) =>
      this.plan.edit(`Set ${titleOf(field.name).toLowerCase()}`, (document) => {
        if (value === undefined) delete document[section][field.name];
        else document[section][field.name] = value;
      }),
    );
  }

  /** @param {string} pattern Settings that the new pattern does not have are left behind. */
  #usePattern(pattern) {
    const known = this.about.planner[pattern].map((field) => field.name);
    this.plan.edit("Choose the pattern", (document) => {
      const taken = Object.entries(document.planner).filter(([name]) => known.includes(name));
      document.planner = { ...Object.fromEntries(taken), pattern };
      if (!SIZES.some((name) => document.planner[name] !== undefined)) document.planner[known.includes("swaths") ? "swaths" : "budget_m"] = known.includes("swaths") ? 8 : 5000;
    });
  }

  /** @param {string} name */
  #useSize(name) {
    const values = /** @type {Record<string, number>} */ ({ swaths: 8, spacing_m: 50, budget_m: 5000, rmse_m: 1 });
    this.plan.edit("Choose what decides the density", (document) => {
      for (const size of SIZES) delete document.planner[size];
      document.planner[name] = values[name];
    });
  }
}

/** @param {HTMLElement} page @returns {HTMLInputElement[]} */
function inputsOf(page) {
  return [...page.querySelectorAll("input, select")].map((input) => /** @type {HTMLInputElement} */ (input));
}

/** @param {HTMLElement} page */
function idsOf(page) {
  return inputsOf(page).map((input) => input.id).join(" ");
}

/**
 * Give a shown input the state of one that was made for the document, unless something is being typed there.
 * @param {HTMLInputElement} shown
 * @param {HTMLInputElement} made
 */
function update(shown, made) {
  const isTyped = shown === document.activeElement && shown.matches("input") && shown.value !== shown.defaultValue;
  if (shown.type === "checkbox") shown.checked = made.checked;
  else if (!isTyped) shown.value = made.value;
  shown.defaultValue = made.defaultValue;
  if (!isTyped) shown.removeAttribute("aria-invalid");
}

/** @param {string} title @param {HTMLElement[]} rows */
function more(title, rows) {
  return element("details", { class: "more" }, element("summary", { text: title }), ...rows);
}
