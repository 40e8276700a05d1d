// The map of a run as it grows swath by swath: a slider through the maps that the server made.
import { element } from "../dom.js";
import { showPicture } from "../map/overlays.js";

/** @typedef {{swaths: number, of: number, elevation: import("../map/overlays.js").Picture, sigma: import("../map/overlays.js").Picture}} Grown */

export class Growth {
  /** @param {any} map @param {import("../map/layers.js").Layers} layers @param {string} name Of the slider and the layers. */
  constructor(map, layers, name = "growth") {
    this.name = name;
    this.map = map;
    this.layers = layers;
    /** @type {Grown[]} */
    this.maps = [];
    this.slider = /** @type {HTMLInputElement} */ (element("input", { type: "range", min: "0", max: "0", step: "1", value: "0", id: name, oninput: () => this.#show(Number(this.slider.value)) }));
    this.label = element("label", { for: name });
    this.part = element("div", { class: "stack", hidden: true }, this.label, this.slider);
  }

  clear() {
    this.maps = [];
    this.part.hidden = true;
    for (const name of [`${this.name}-elevation`, `${this.name}-sigma`]) this.layers.remove(name);
  }

  /** @param {Grown} grown */
  add(grown) {
    this.maps.push(grown);
    this.part.hidden = false;
    this.slider.max = String(this.maps.length - 1);
    this.slider.value = this.slider.max;
    this.#show(this.maps.length - 1);
  }

  /** @param {number} index */
  #show(index) {
    const { swaths, of, elevation, sigma } = this.maps[index];
    this.label.textContent = `Map after ${swaths} of ${of} swaths`;
    showPicture(this.map, this.layers, `${this.name}-elevation`, "Map as it grows", elevation);
    showPicture(this.map, this.layers, `${this.name}-sigma`, "σ as it grows", sigma);
  }
}
