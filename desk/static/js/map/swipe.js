// Swipe: one layer is drawn to the left of a line, another one to the right of it, so that both can be compared.
import { byId, element } from "../dom.js";

/** @typedef {import("./layers.js").Entry} Entry */

export class Swipe {
  /** @param {any} map */
  constructor(map) {
    this.map = map;
    /** @type {Entry[]} */
    this.entries = [];
    this.isOn = false;
    this.line = /** @type {HTMLInputElement} */ (element("input", { type: "range", min: "0", max: "1", step: "0.005", value: "0.5", id: "swipe", "aria-label": "Line between the two layers", hidden: true, oninput: () => this.#move() }));
    this.mark = element("div", { id: "swipe-line", hidden: true, "aria-hidden": "true" });
    byId("stage").append(this.mark, this.line);
    const on = element("input", { type: "checkbox", id: "swipe-on", onchange: (/** @type {any} */ event) => this.#turn(event.target.checked) });
    this.left = this.#chooser("swipe-left", "On the left");
    this.right = this.#chooser("swipe-right", "On the right");
    this.choice = element("div", { class: "stack", hidden: true }, this.left, this.right);
    this.row = element("div", { class: "swipe" }, element("div", { class: "layer" }, on, element("label", { for: "swipe-on", text: "Compare two by a swipe" })), this.choice);
  }

  /** @param {string} id @param {string} title */
  #chooser(id, title) {
    return /** @type {HTMLSelectElement} */ (element("select", { id, "aria-label": title, onchange: () => this.#show() }));
  }

  /** @param {Entry[]} entries Layers that can be compared. */
  offer(entries) {
    for (const entry of entries) if (!this.entries.includes(entry)) this.#cut(entry);
    this.entries = entries;
    for (const [select, preferred] of /** @type {[HTMLSelectElement, number][]} */ ([[this.left, 0], [this.right, entries.length - 1]])) {
      const chosen = select.value || entries[preferred]?.name;
      select.replaceChildren(...entries.map((entry) => element("option", { value: entry.name, text: entry.title, selected: entry.name === chosen })));
    }
  }

  /** @param {string} left @param {string} right Names of the layers that are compared. */
  compare(left, right) {
    [this.left.value, this.right.value] = [left, right];
    /** @type {HTMLInputElement} */ (this.row.querySelector("#swipe-on")).checked = true;
    this.#turn(true);
  }

  /** End the comparison. */
  end() {
    /** @type {HTMLInputElement} */ (this.row.querySelector("#swipe-on")).checked = false;
    this.#turn(false);
  }

  /** @param {boolean} isOn */
  #turn(isOn) {
    this.isOn = isOn;
    for (const part of [this.line, this.mark, this.choice]) part.hidden = !isOn;
    this.#show();
  }

  /** Show both layers. */
  #show() {
    for (const entry of this.entries) if (this.isOn && [this.left.value, this.right.value].includes(entry.name)) entry.layer.setVisible(true);
    this.#move();
  }

  #move() {
    this.mark.style.left = `${Number(this.line.value) * 100}%`;
    this.map.render();
  }

  /** @param {Entry} entry */
  #cut(entry) {
    entry.layer.on("prerender", (/** @type {any} */ event) => {
      const { context } = event, { width, height } = context.canvas, at = width * Number(this.line.value);
      context.save();
      if (!this.isOn || this.left.value === this.right.value) return;
      const isLeft = entry.name === this.left.value;
      if ((!isLeft && entry.name !== this.right.value) || entry.isBase) return;
      context.beginPath();
      context.rect(isLeft ? 0 : at, 0, isLeft ? at : width - at, height);
      context.clip();
    });
    entry.layer.on("postrender", (/** @type {any} */ event) => event.context.restore());
  }
}
