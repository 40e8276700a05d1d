// Terrain on the map: relief in colours that suit the view, slope, contour lines.
import { get } from "../server/api.js";

/** @typedef {import("../types.js").Site} Site */
const ol = /** @type {any} */ (globalThis).ol;
const INK = "rgba(38,50,62,.8)";
const SETTLED_MS = 180;

export class Terrain {
  /** @param {any} map @param {Site} site */
  constructor(map, site) {
    this.map = map;
    this.site = site;
    this.style = site.style;
    this.intervalM = 0;
    this.events = new EventTarget();
    this.relief = this.#tiles("relief", true);
    this.slope = this.#tiles("slope", false);
    this.slope.setOpacity(0.6);
    this.slope.setZIndex(2);
    this.lines = new ol.source.Vector();
    this.contours = new ol.layer.Vector({ source: this.lines, style: lineStyle, zIndex: 4, visible: false, declutter: true });
    /** @type {number|undefined} */
    this.timer = undefined;
    map.on("moveend", () => this.#later());
    this.contours.on("change:visible", () => this.#later());
  }

  /** @param {string} name @param {boolean} visible */
  #tiles(name, visible) {
    const { extent, resolutions_m: resolutions, tile_cells: tileSize } = this.site.tiles;
    const source = new ol.source.TileImage({
      projection: this.map.getView().getProjection(),
      tileGrid: new ol.tilegrid.TileGrid({ extent, origin: [extent[0], extent[3]], resolutions, tileSize }),
      tileUrlFunction: (/** @type {number[]} */ [zoom, column, row]) => this.#address(name, `${zoom}/${column}/${row}`),
      transition: 0,
    });
    return new ol.layer.Tile({ source, visible, preload: 1 });
  }

  /** @param {string} name @param {string} place */
  #address(name, place) {
    return `/tiles/${name}/${place}.png${name === "relief" ? `?style=${this.style.text}` : ""}`;
  }

  /** Wait until the map stands still. */
  #later() {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.#follow(), SETTLED_MS);
  }

  async #follow() {
    const bounds = this.map.getView().calculateExtent(this.map.getSize()).join(",");
    const found = await get(`/api/style?bounds=${bounds}&shown=${this.style.text}`).catch(() => null);
    if (found && found.text !== this.style.text) {
      this.style = found;
      // With a key of its own the tiles that are shown stay until those in the new colours have come.
      this.relief.getSource().setTileUrlFunction((/** @type {number[]} */ place) => this.#address("relief", place.join("/")), found.text);
      this.events.dispatchEvent(new Event("change"));
    }
    if (this.contours.getVisible()) await this.#drawContours(bounds);
    document.documentElement.dataset.terrain = this.style.text;
  }

  /** @param {string} bounds */
  async #drawContours(bounds) {
    const found = await get(`/api/contours?bounds=${bounds}`).catch(() => null);
    if (!found) return;
    this.intervalM = found.interval_m;
    this.lines.clear(true);
    this.lines.addFeatures(found.lines.map((/** @type {any} */ line) => new ol.Feature({ geometry: new ol.geom.LineString(line.places), height: line.height_m, isIndex: line.is_index })));
    this.events.dispatchEvent(new Event("change"));
  }
}

/** @param {any} feature */
function lineStyle(feature) {
  const isIndex = feature.get("isIndex");
  const stroke = new ol.style.Stroke({ color: INK, width: isIndex ? 1.5 : 0.7 });
  if (!isIndex) return new ol.style.Style({ stroke });
  const halo = new ol.style.Stroke({ color: "rgba(255,255,255,.85)", width: 3 });
  const text = new ol.style.Text({ text: `${feature.get("height")} m`, placement: "line", font: "12px system-ui, sans-serif", fill: new ol.style.Fill({ color: "#26323e" }), stroke: halo });
  return new ol.style.Style({ stroke, text });
}
