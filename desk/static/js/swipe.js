// A swipe: layers over the terrain are drawn to the left of a line only, so that both sides can be compared.
import { element } from "./dom.js";

export class Swipe {
  /** @param {any} map */
  constructor(map) {
    this.map = map;
    this.share = 1;
    const slider = element("input", { type: "range", min: "0", max: "1", step: "0.01", value: "1", id: "swipe", oninput: (/** @type {any} */ event) => this.#move(Number(event.target.value)) });
    this.row = element("div", { class: "layer swipe" }, element("label", { for: "swipe", text: "Swipe" }), slider);
  }

  /** @param {any} layer Is cut from now on. */
  cut(layer) {
    layer.on("prerender", (/** @type {any} */ event) => {
      const context = event.context;
      context.save();
      context.beginPath();
      context.rect(0, 0, context.canvas.width * this.share, context.canvas.height);
      context.clip();
    });
    layer.on("postrender", (/** @type {any} */ event) => event.context.restore());
  }

  /** @param {number} share Of the width of the map. */
  #move(share) {
    this.share = share;
    this.map.render();
  }
}
