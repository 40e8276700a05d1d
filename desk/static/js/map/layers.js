// The list of layers with their opacity, and the legends of those that are shown.
import { byId, element } from "../dom.js";

/** @typedef {{name: string, title: string, layer: any, legend?: () => Legend|null, isPicture?: boolean, isBase?: boolean}} Entry
 * Pictures can be compared by a swipe; the base stays below both sides. */
/** @typedef {{title: string, colours: string[], low: string, high: string}} Legend */

/** Legends beyond these are folded up. */
const MOST_LEGENDS = 2;

export class Layers {
  /** @param {any} map @param {Entry[]} entries From the top down. @param {import("./swipe.js").Swipe} swipe */
  constructor(map, entries, swipe) {
    this.map = map;
    this.entries = entries;
    this.swipe = swipe;
    const open = matchMedia("(min-width: 761px)").matches;
    this.list = element("div", { class: "list" }, ...entries.map((entry) => this.#row(entry)), swipe.row);
    byId("layers").append(element("details", { open }, element("summary", { text: "Layers" }), this.list));
    this.#changed();
  }

  /** @param {Entry} entry A layer of the same name is replaced. */
  add(entry) {
    this.remove(entry.name);
    this.entries.unshift(entry);
    const remove = element("button", { type: "button", class: "quiet remove", text: "×", title: `Remove ${entry.title}`, "aria-label": `Remove ${entry.title}`, onclick: () => this.remove(entry.name) });
    const row = this.#row(entry);
    row.append(remove);
    this.list.prepend(row);
    this.#changed();
  }

  /** @param {string} name */
  remove(name) {
    const old = this.entries.find((entry) => entry.name === name);
    if (!old) return;
    this.map.removeLayer(old.layer);
    this.entries = this.entries.filter((entry) => entry !== old);
    this.list.querySelector(`#show-${CSS.escape(name)}`)?.closest(".layer")?.remove();
    this.#changed();
  }

  #changed() {
    this.swipe.offer(this.entries.filter((entry) => entry.isPicture));
    this.legends();
  }

  /** Show the legends of the visible layers. */
  legends() {
    const found = this.entries.filter((entry) => entry.layer.getVisible()).map((entry) => entry.legend?.() ?? null);
    const ramps = found.flatMap((legend) => (legend ? [ramp(legend)] : []));
    const isOpen = byId("legend").querySelector("details")?.open ?? false;
    const others = ramps.splice(MOST_LEGENDS);
    const more = others.length ? [element("details", { class: "ramp", open: isOpen }, element("summary", { text: `${others.length} more` }), ...others)] : [];
    byId("legend").replaceChildren(...ramps, ...more);
  }

  /** @param {Entry} entry */
  #row(entry) {
    const shown = element("input", {
      type: "checkbox", id: `show-${entry.name}`, checked: entry.layer.getVisible(),
      onchange: (/** @type {any} */ event) => entry.layer.setVisible(event.target.checked),
    });
    entry.layer.on("change:visible", () => {
      /** @type {HTMLInputElement} */ (shown).checked = entry.layer.getVisible();
      this.legends();
    });
    const opacity = element("input", {
      type: "range", min: "0", max: "1", step: "0.05", value: String(entry.layer.getOpacity()), "aria-label": `Opacity of ${entry.title}`,
      oninput: (/** @type {any} */ event) => entry.layer.setOpacity(Number(event.target.value)),
    });
    return element("div", { class: "layer" }, shown, element("label", { for: `show-${entry.name}`, text: entry.title }), opacity);
  }
}

/** @param {Legend} legend */
function ramp(legend) {
  const space = "http://www.w3.org/2000/svg";
  const picture = document.createElementNS(space, "svg");
  picture.setAttribute("viewBox", `0 0 ${legend.colours.length} 1`);
  picture.setAttribute("preserveAspectRatio", "none");
  picture.setAttribute("aria-hidden", "true");
  legend.colours.forEach((colour, index) => {
    const cell = document.createElementNS(space, "rect");
    for (const [name, value] of Object.entries({ x: index, y: 0, width: 1.02, height: 1, fill: colour })) cell.setAttribute(name, String(value));
    picture.append(cell);
  });
  const ends = element("div", {}, element("span", { text: legend.low }), element("span", { text: legend.high }));
  return element("div", { class: "ramp" }, element("span", { text: legend.title }), picture, ends);
}
