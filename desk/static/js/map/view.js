// The map: terrain tiles in the projected CRS of the terrain, scale bar, place under the pointer.
import { byId, iconButton } from "../dom.js";
import { post } from "../server/api.js";

/** @typedef {import("../types.js").Site} Site */
const ol = /** @type {any} */ (globalThis).ol;

/**
 * Create the map of a site.
 * @param {Site} site
 */
export function createMap(site) {
  const extent = site.tiles.extent;
  const projection = new ol.proj.Projection({
    code: "terrain",
    units: "m",
    extent,
    getPointResolution: (/** @type {number} */ resolution) => resolution / site.grid_per_ground,
  });
  const finest = site.tiles.resolutions_m.at(-1) ?? 1;
  const margin = 0.5 * Math.max(extent[2] - extent[0], extent[3] - extent[1]);
  const map = new ol.Map({
    target: "map",
    controls: [new ol.control.ScaleLine({ target: byId("scale"), minWidth: 70 })],
    keyboardEventTarget: byId("map"),
    view: new ol.View({
      projection,
      extent: [extent[0] - margin, extent[1] - margin, extent[2] + margin, extent[3] + margin],
      maxResolution: Math.max(site.tiles.resolutions_m[0] * 2, (extent[2] - extent[0]) / 200),
      minResolution: Math.min(finest / 64, 0.05),
      constrainResolution: false,
      enableRotation: false,
    }),
  });
  map.getView().fit(extent, { padding: [24, 24, 24, 24] });
  showPlace(map, site);
  return map;
}

/** @param {any} map @param {Site} site */
function showPlace(map, site) {
  const readout = byId("place");
  let asked = 0;
  /** @type {number|undefined} */
  let timer;
  map.on("pointermove", (/** @type {any} */ event) => {
    const [x, y] = event.coordinate;
    const text = `E ${x.toFixed(1)}  N ${y.toFixed(1)}`;
    readout.textContent = text;
    clearTimeout(timer);
    const number = ++asked;
    timer = setTimeout(async () => {
      const found = await post("/api/heights", { places: [[x, y]] }).catch(() => null);
      const height = found?.heights_m[0];
      if (number === asked && height !== null && height !== undefined) readout.textContent = `${text}  ${height.toFixed(1)} m`;
    }, 60);
  });
  readout.title = site.crs.name;
}

/**
 * Return buttons that zoom, for people who do not scroll.
 * @param {any} map
 * @param {() => void} fit
 */
export function zoomButtons(map, fit) {
  const by = (/** @type {number} */ step) => () => {
    const view = map.getView();
    const duration = matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 160;
    view.animate({ zoom: view.getZoom() + step, duration });
  };
  return [iconButton("zoomIn", "Zoom in", by(0.8)), iconButton("zoomOut", "Zoom out", by(-0.8)), iconButton("fit", "Show the area", fit)];
}
