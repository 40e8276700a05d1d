// The elevation profile along the route, with its place on the map.
import { get } from "./api.js";
import { chart, pathOf, svg } from "./chart.js";
import { byId, element } from "./dom.js";
import { ROVERS } from "./route.js";

const ol = /** @type {any} */ (globalThis).ol;

export class Profile {
  constructor() {
    this.source = new ol.source.Vector();
    const image = new ol.style.Circle({ radius: 7, fill: new ol.style.Fill({ color: "#ffffff" }), stroke: new ol.style.Stroke({ color: "#17232e", width: 2.5 }) });
    this.layer = new ol.layer.Vector({ source: this.source, style: new ol.style.Style({ image }), zIndex: 30 });
    this.isOpen = false;
  }

  /** @param {boolean} isOpen */
  async open(isOpen) {
    this.isOpen = isOpen;
    byId("profile").hidden = !isOpen;
    byId("stage").classList.toggle("with-profile", isOpen);
    this.source.clear();
    if (isOpen) await this.refresh();
  }

  async refresh() {
    if (!this.isOpen) return;
    const found = await get("/api/profile").catch(() => ({ rovers: [] }));
    if (found.rovers.length) this.#draw(found.rovers);
    else byId("profile").replaceChildren(element("p", { class: "note", text: "There is no route yet." }));
  }

  /** @param {{rover: number, distance_m: number[], heights_m: (number|null)[], places: number[][]}[]} rovers */
  #draw(rovers) {
    const heights = rovers.flatMap((one) => one.heights_m).filter((height) => height !== null);
    const longest = Math.max(...rovers.map((one) => one.distance_m.at(-1) ?? 0));
    const [low, high] = [Math.min(...heights), Math.max(...heights)];
    const width = Math.max(320, byId("profile").clientWidth - 24);
    const axes = chart({ title: `Elevation along the route, ${low.toFixed(0)} to ${high.toFixed(0)} m`, xTitle: "distance [km]", yTitle: "elevation [m]", xs: [0, longest / 1000], ys: [low, Math.max(high, low + 1)], width, height: 150 });
    for (const one of rovers) {
      const known = one.distance_m.flatMap((distance, k) => (one.heights_m[k] === null ? [] : [/** @type {[number, number]} */ ([axes.x(distance / 1000), axes.y(Number(one.heights_m[k]))])]));
      const path = svg("path", { d: pathOf(known), class: "curve" });
      path.setAttribute("stroke", ROVERS[one.rover % ROVERS.length]);
      axes.picture.append(path);
    }
    const slider = element("input", { type: "range", min: "0", max: "1", step: "0.002", value: "0", id: "along", "aria-label": "Place along the route", oninput: (/** @type {any} */ event) => this.#mark(rovers[0], Number(event.target.value)) });
    axes.picture.addEventListener("pointermove", (event) => {
      const box = axes.picture.getBoundingClientRect();
      const distance = axes.xAt(((/** @type {PointerEvent} */ (event).clientX - box.left) / box.width) * width) * 1000;
      this.#mark(rovers[0], distance / longest);
    });
    byId("profile").replaceChildren(axes.picture, slider, element("p", { class: "small", id: "along-text" }));
  }

  /** @param {{distance_m: number[], heights_m: (number|null)[], places: number[][]}} rover @param {number} share */
  #mark(rover, share) {
    const index = Math.round(Math.min(Math.max(share, 0), 1) * (rover.places.length - 1));
    this.source.clear();
    this.source.addFeature(new ol.Feature(new ol.geom.Point(rover.places[index])));
    const height = rover.heights_m[index];
    byId("along-text").textContent = `${(rover.distance_m[index] / 1000).toFixed(2)} km, ${height === null ? "height unknown" : `${height.toFixed(1)} m`}`;
  }
}
