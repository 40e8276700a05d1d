// The table of corners: every polygon and start as typed coordinates.
import { element } from "../dom.js";
import { fieldRow } from "./form.js";
import { MARKS } from "../map/shapes.js";
import { post } from "../server/api.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
/** @typedef {import("../map/tools.js").Tools} Tools */
/** @typedef {import("../types.js").Place} Place */
const TITLES = /** @type {Record<string, string>} */ ({ areas: "Area", no_go: "No-go zone", starts: "Start", stakes: "Stake", checkpoints: "Checkpoint" });

export class Corners {
  /**
   * @param {Plan} plan @param {Tools} tools @param {() => Place[]} square A first outline in the middle of the map.
   * @param {(sentence: string) => void} notify
   */
  constructor(plan, tools, square, notify) {
    this.notify = notify;
    this.wanted = { n: 30, max_slope_deg: 10, reach_m: /** @type {number|undefined} */ (undefined) };
    this.plan = plan;
    this.tools = tools;
    this.square = square;
    this.page = element("div");
    plan.addEventListener("change", () => this.show());
    tools.events.addEventListener("select", () => this.show());
    // A table that was not drawn again while a number was typed is drawn once the focus has moved on.
    this.isLate = false;
    this.page.addEventListener("focusout", () => setTimeout(() => this.isLate && this.show()));
  }

  show() {
    const focused = document.activeElement;
    this.isLate = this.page.contains(focused) && isBegun(focused);
    if (this.isLate) return;
    const document_ = /** @type {any} */ (this.plan.document);
    const shapes = Object.keys(TITLES).flatMap((role) => document_[role].map((/** @type {any} */ _, /** @type {number} */ index) => `${role}-${index}`));
    const chosen = this.tools.selected && shapes.includes(this.tools.selected) ? this.tools.selected : shapes[0];
    this.page.replaceChildren(element("h2", { text: "Shapes and corners" }), this.#adding(), this.#proposing(), ...(chosen ? [this.#choosing(shapes, chosen), ...this.#tables(chosen)] : []));
    this.#focus(focused?.id);
  }

  /** @param {string | undefined} id Of the field that had the focus before the table was drawn again. */
  #focus(id) {
    const field = id ? this.page.querySelector(`#${CSS.escape(id)}`) : null;
    if (field instanceof HTMLElement) field.focus();
    if (field instanceof HTMLInputElement && field.type === "number") field.select();
  }

  #adding() {
    const add = (/** @type {string} */ title, /** @type {string} */ role, /** @type {string} */ name) =>
      element("button", { type: "button", text: title, onclick: () => this.#add(role, name) });
    return element("div", { class: "row" }, add("Add an area", "areas", "Draw an area"), add("Add a no-go zone", "no_go", "Draw a no-go zone"), add("Add a start", "starts", "Mark a start"), add("Add a stake", "stakes", "Set a stake"), add("Add a checkpoint", "checkpoints", "Mark a checkpoint"));
  }

  #proposing() {
    const row = (/** @type {"n"|"max_slope_deg"|"reach_m"} */ name, /** @type {string} */ title, /** @type {string} */ help, /** @type {any} */ ground) =>
      fieldRow("propose", { name, help, default: ground, kind: name === "n" ? "integer" : "number", choices: [] }, this.wanted[name], (value) => void (this.wanted[name] = value ?? ground), title);
    return element("details", { class: "more", open: this.page.querySelector("details")?.open ?? false },
      element("summary", { text: "Propose checkpoints" }),
      row("n", "Number", "How many checkpoints.", 30), row("max_slope_deg", "Largest slope", "Steeper ground gets no checkpoint: there an error in place is one in height.", 10),
      row("reach_m", "Reach", "Largest distance from the route; anywhere in the area without one.", undefined),
      element("button", { type: "button", id: "propose-checkpoints", text: "Propose checkpoints", onclick: () => this.#propose() }));
  }

  /** @param {string} role @param {string} title */
  #add(role, title) {
    const square = this.square();
    const index = /** @type {any} */ (this.plan.document)[role].length;
    const middle = [(square[0][0] + square[2][0]) / 2, (square[0][1] + square[2][1]) / 2];
    const quarter = square.map(([x, y]) => [(x + middle[0]) / 2, (y + middle[1]) / 2]);
    const made = role in MARKS ? middle : [role === "areas" ? square : quarter];
    this.plan.edit(title, (document) => void (/** @type {any} */ (document)[role].push(made))).then(() => this.tools.select(`${role}-${index}`));
  }

  /** Replace the checkpoints by well spread ones. */
  async #propose() {
    try {
      const { places, note } = await post("/api/checkpoints", this.wanted);
      await this.plan.edit("Propose checkpoints", (document) => void (document.checkpoints = places));
      this.notify(note && `Not all could be kept: ${note}`);
    } catch (error) {
      this.plan.dispatchEvent(new CustomEvent("refused", { detail: error instanceof Error ? error.message : String(error) }));
    }
  }

  /** @param {string[]} shapes @param {string} chosen */
  #choosing(shapes, chosen) {
    const options = shapes.map((id) => {
      const [role, index] = id.split("-");
      return element("option", { value: id, text: `${TITLES[role]} ${Number(index) + 1}`, selected: id === chosen });
    });
    const select = element("select", { id: "shape", onchange: (/** @type {any} */ event) => this.tools.select(event.target.value) }, ...options);
    const remove = element("button", { type: "button", text: "Remove", onclick: () => (this.tools.select(chosen), this.tools.removeSelected()) });
    return element("div", { class: "field" }, element("label", { for: "shape", text: "Shape" }), element("span", { class: "input" }, select, remove));
  }

  /** @param {string} id */
  #tables(id) {
    const [role, index] = id.split("-");
    const shape = /** @type {any} */ (this.plan.document)[role][Number(index)];
    if (role in MARKS) return [this.#table([shape], TITLES[role], (document) => [document[role][Number(index)]], (document, places) => (document[role][Number(index)] = places[0]))];
    return shape.map((/** @type {Place[]} */ ring, /** @type {number} */ hole) =>
      this.#table(ring, hole ? `Hole ${hole}` : "Outline", (document) => document[role][Number(index)][hole], (document, places) => (document[role][Number(index)][hole] = places)));
  }

  /**
   * @param {Place[]} places
   * @param {string} title
   * @param {(document: any) => Place[]} read
   * @param {(document: any, places: Place[]) => void} write
   */
  #table(places, title, read, write) {
    const edit = (/** @type {string} */ what, /** @type {(places: Place[]) => Place[]} */ change) =>
      this.plan.edit(what, (document) => write(document, change(structuredClone(read(document)))));
    const rows = places.map((place, row) => this.#row(place, row, title, places.length, edit));
    const head = element("tr", {}, ...["No.", "Easting [m]", "Northing [m]", "Edit"].map((text) => element("th", { scope: "col", text })));
    return element("div", { class: "rows" }, element("table", { "aria-label": `Corners of ${title}` }, element("caption", { class: "small", text: title }), element("thead", {}, head), element("tbody", {}, ...rows)));
  }

  /** @param {Place} place @param {number} row @param {string} title @param {number} n @param {any} edit */
  #row(place, row, title, n, edit) {
    const input = (/** @type {number} */ axis) =>
      element("td", {}, element("input", {
        type: "number", step: "any", value: String(place[axis]), id: `corner-${title}-${row}-${axis}`.replaceAll(" ", "-"),
        "aria-label": `${axis ? "Northing" : "Easting"} of corner ${row + 1} [m]`,
        onchange: (/** @type {any} */ event) => {
          const value = Number(event.target.value);
          const isBad = event.target.value.trim() === "" || !Number.isFinite(value);
          event.target.setAttribute("aria-invalid", String(isBad));
          if (!isBad) event.target.defaultValue = event.target.value;
          if (!isBad) edit("Type a corner", (/** @type {Place[]} */ places) => places.map((p, k) => (k === row ? (axis ? [p[0], value] : [value, p[1]]) : p)));
        },
      }));
    const button = (/** @type {string} */ text, /** @type {string} */ label, /** @type {() => void} */ action, disabled = false) =>
      element("button", { type: "button", class: "quiet", text, title: label, "aria-label": label, disabled, onclick: action });
    const insert = () => edit("Insert a corner", (/** @type {Place[]} */ places) => places.toSpliced(row + 1, 0, between(places[row], places[(row + 1) % places.length])));
    const remove = () => edit("Remove a corner", (/** @type {Place[]} */ places) => places.toSpliced(row, 1));
    const isPoint = Object.values(MARKS).some((mark) => mark.title === title);
    const actions = isPoint ? [] : [button("+", `Insert a corner after ${row + 1}`, insert), button("−", `Remove corner ${row + 1}`, remove, n <= 3)];
    return element("tr", {}, element("th", { scope: "row", text: String(row + 1) }), input(0), input(1), element("td", { class: "row" }, ...actions));
  }
}

/**
 * Whether an element is a number that the user has begun to type and not entered.
 * @param {Element | null} field
 */
function isBegun(field) {
  return field instanceof HTMLInputElement && field.type === "number" && field.value !== field.defaultValue;
}

/** @param {Place} a @param {Place} b @returns {Place} */
function between(a, b) {
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
}
