// The drive of the plan in time: elevation along the route or a swath, and where each rover is.
import { chart, pathOf, svg } from "../chart.js";
import { byId, element } from "../dom.js";
import { get } from "../server/api.js";
import { Player } from "./player.js";
import { ROVERS } from "./route.js";

/** @typedef {import("../types.js").RoverDrive} RoverDrive */
/** @typedef {{rover: number, first: number, last: number}} Part */
const ol = /** @type {any} */ (globalThis).ol;
const HEIGHT = 138, STEPS = 1000;

export class Drive {
  /** @param {() => void} close What the button in the corner does. */
  constructor(close) {
    this.source = new ol.source.Vector();
    this.layer = new ol.layer.Vector({ source: this.source, style: markerStyle, zIndex: 30 });
    this.isOpen = false;
    /** @type {RoverDrive[]} */
    this.rovers = [];
    /** @type {Part[]} */
    this.parts = [];
    this.timeS = 0;
    this.player = new Player("play", () => [this.#timeOf(0), this.#timeOf(1)], () => this.timeS, (timeS) => this.#at(timeS));
    this.choice = /** @type {HTMLSelectElement} */ (element("select", { id: "drive-part", "aria-label": "Part of the drive", onchange: () => this.#show() }));
    this.text = element("p", { id: "drive-text", role: "status" });
    this.slider = /** @type {HTMLInputElement} */ (element("input", { type: "range", min: "0", max: String(STEPS), step: "1", value: "0", id: "time", "aria-label": "Time of the drive", oninput: () => this.#at(this.#timeOf(Number(this.slider.value) / STEPS)) }));
    this.picture = element("div");
    byId("drive").append(element("div", { class: "row" }, this.player.button, this.choice, this.text, element("button", { type: "button", class: "quiet close", text: "×", title: "Close the drive", "aria-label": "Close the drive", onclick: close })), this.picture, this.slider);
  }

  /** @param {boolean} isOpen */
  async open(isOpen) {
    this.isOpen = isOpen;
    byId("drive").hidden = !isOpen;
    byId("stage").classList.toggle("with-drive", isOpen);
    this.player.stop();
    this.source.clear();
    this.slider.value = "0";
    if (isOpen) await this.refresh();
  }

  async refresh() {
    if (!this.isOpen) return;
    this.rovers = (await get("/api/drive").catch(() => ({ rovers: [] }))).rovers;
    this.parts = this.rovers.flatMap((one, rover) => [{ rover, first: 0, last: one.places.length - 1 }, ...one.swaths.map(([first, last]) => ({ rover, first, last }))]);
    const chosen = Math.min(Math.max(this.choice.selectedIndex, 0), this.parts.length - 1);
    this.choice.replaceChildren(...this.rovers.flatMap((one, rover) => this.#options(one, rover)));
    this.choice.selectedIndex = chosen;
    this.#show(Number(this.slider.value) / STEPS);
  }

  /** @param {RoverDrive} one @param {number} rover */
  #options(one, rover) {
    const prefix = this.rovers.length > 1 ? `Rover ${rover + 1}, ` : "";
    const names = ["entire route", ...one.swaths.map((_, k) => `swath ${k + 1}`)].map((name) => prefix + name);
    return names.map((name) => element("option", { text: name.charAt(0).toUpperCase() + name.slice(1) }));
  }

  get #part() {
    return this.parts[Math.max(this.choice.selectedIndex, 0)];
  }

  /** @param {number} share @returns {number} Seconds. */
  #timeOf(share) {
    if (!this.parts.length) return 0;
    const { rover, first, last } = this.#part, times = this.rovers[rover].time_s;
    const [begin, end] = first === 0 ? [0, Math.max(...this.rovers.map((one) => one.time_s.at(-1) ?? 0))] : [times[first], times[last]];
    return begin + share * (end - begin);
  }

  /** @param {number} share Of the time of the part. */
  #show(share = 0) {
    if (!this.parts.length) {
      this.picture.replaceChildren(element("p", { class: "note", text: "There is no route yet." }));
      return;
    }
    this.#draw();
    this.#at(this.#timeOf(share));
  }

  #draw() {
    const { rover, first, last } = this.#part, one = this.rovers[rover];
    const km = one.distance_m.slice(first, last + 1).map((distance) => distance / 1000);
    const heights = one.heights_m.slice(first, last + 1);
    const known = heights.filter((height) => height !== null);
    const [low, high] = known.length ? [Math.min(...known), Math.max(...known)] : [0, 1];
    const width = Math.max(320, byId("drive").clientWidth - 24);
    const axes = chart({ title: `Elevation, ${low.toFixed(0)} to ${high.toFixed(0)} m`, xTitle: "distance [km]", yTitle: "elevation [m]", xs: [km[0], km.at(-1) ?? 1], ys: [low, Math.max(high, low + 1)], width, height: HEIGHT });
    const places = km.flatMap((distance, k) => (heights[k] === null ? [] : [/** @type {[number, number]} */ ([axes.x(distance), axes.y(Number(heights[k]))])]));
    const path = svg("path", { d: pathOf(places), class: "curve" });
    /** @type {SVGElement} */ (path).style.stroke = ROVERS[rover % ROVERS.length];
    this.cursor = svg("line", { y1: 12, y2: HEIGHT - 34, class: "cursor" });
    this.axes = axes;
    axes.picture.append(path, this.cursor);
    const follow = (/** @type {PointerEvent} */ event) => this.#atPixel(event, width);
    axes.picture.addEventListener("pointerdown", (event) => {
      axes.picture.setPointerCapture(event.pointerId);
      follow(event);
    });
    axes.picture.addEventListener("pointermove", (event) => event.buttons && follow(event));
    this.picture.replaceChildren(axes.picture);
  }

  /** @param {PointerEvent} event @param {number} width */
  #atPixel(event, width) {
    const { rover, first, last } = this.#part, one = this.rovers[rover];
    const box = this.picture.getBoundingClientRect();
    const distance = (this.axes?.xAt(((event.clientX - box.left) / box.width) * width) ?? 0) * 1000;
    const index = Math.min(Math.max(indexAt(one.distance_m, distance), first), last);
    this.#at(one.time_s[index]);
  }

  /** @param {number} timeS Show where the rovers are. */
  #at(timeS) {
    if (!this.parts.length) return;
    this.timeS = timeS;
    const [begin, end] = [this.#timeOf(0), this.#timeOf(1)];
    this.slider.value = String(Math.round(((timeS - begin) / (end - begin || 1)) * STEPS));
    this.source.clear(true);
    const { rover: chosen, first, last } = this.#part;
    this.rovers.forEach((one, rover) => {
      const index = indexAt(one.time_s, timeS);
      this.source.addFeature(new ol.Feature({ geometry: new ol.geom.Point(one.places[index]), rover }));
      if (rover !== chosen) return;
      this.text.textContent = describe(one, index, timeS);
      this.slider.setAttribute("aria-valuetext", this.text.textContent);
      const at = this.axes?.x(one.distance_m[Math.min(Math.max(index, first), last)] / 1000) ?? 0;
      for (const name of ["x1", "x2"]) this.cursor?.setAttribute(name, String(at));
    });
  }
}

/** @param {number[]} values Not falling. @param {number} value @returns {number} Index of the last one that is not above. */
export function indexAt(values, value) {
  let low = 0, high = values.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (values[middle] <= value) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** @param {number} timeS */
export function clockText(timeS) {
  return `${Math.floor(timeS / 3600)} h ${String(Math.floor((timeS % 3600) / 60)).padStart(2, "0")} min`;
}

/** @param {RoverDrive} one @param {number} index @param {number} timeS */
function describe(one, index, timeS) {
  const height = one.heights_m[index], battery = one.battery_share?.[index];
  const energy = battery === undefined ? `${(one.energy_j[index] / 3.6e6).toFixed(2)} kWh used` : `battery ${(100 * battery).toFixed(0)} %`;
  return [clockText(timeS), `${(one.distance_m[index] / 1000).toFixed(2)} km`, height === null ? "height unknown" : `${height.toFixed(0)} m high`, energy].join(" · ");
}

/** @param {any} feature */
function markerStyle(feature) {
  const rover = feature.get("rover");
  const image = new ol.style.Circle({ radius: 9, fill: new ol.style.Fill({ color: ROVERS[rover % ROVERS.length] }), stroke: new ol.style.Stroke({ color: "#ffffff", width: 3 }) });
  const text = new ol.style.Text({ text: String(rover + 1), font: "bold 11px system-ui, sans-serif", fill: new ol.style.Fill({ color: "#ffffff" }) });
  return new ol.style.Style({ image, text });
}
