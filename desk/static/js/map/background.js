// The background that the user chose: tiles of a local picture from the server, or of the map service that was named.

const ol = /** @type {any} */ (globalThis).ol;
const MERCATOR = "EPSG:3857";
/** Zoom beyond which few services have tiles. */
const FINEST_ZOOM = 19;

/** @typedef {import("../types.js").Background} Background */
/** @typedef {import("../types.js").Polynomial} Polynomial */

/**
 * Show a background below everything but the terrain; one before it is replaced.
 * @param {any} map @param {import("./layers.js").Layers} layers @param {Background} about
 */
export function showBackground(map, layers, about) {
  const layer = new ol.layer.Tile({ source: sourceOf(map, about), zIndex: 1 });
  layers.add({ name: "background", title: `Background: ${about.title}`, layer, isPicture: true });
  map.addLayer(layer);
}

/** @param {any} map @param {Background} about */
function sourceOf(map, about) {
  const projection = map.getView().getProjection();
  if (about.to_mercator && about.from_mercator) {
    ol.proj.addCoordinateTransforms(projection, MERCATOR, values(about.to_mercator), values(about.from_mercator));
    return new ol.source.XYZ({ url: about.address, projection: MERCATOR, maxZoom: FINEST_ZOOM, transition: 0 });
  }
  const { extent, resolutions_m: resolutions, tile_cells: tileSize } = /** @type {import("../types.js").TileGrid} */ (about.grid);
  const tileGrid = new ol.tilegrid.TileGrid({ extent, origin: [extent[0], extent[3]], resolutions, tileSize });
  const tileUrlFunction = (/** @type {number[]} */ tile) => {
    const places = /** @type {Record<string, any>} */ ({ z: tile[0], x: tile[1], y: tile[2], bbox: tileGrid.getTileCoordExtent(tile).join(",") });
    return about.address.replace(/\{(z|x|y|bbox)\}/g, (_, name) => places[name]);
  };
  return new ol.source.TileImage({ projection, tileGrid, tileUrlFunction, transition: 0 });
}

/** @param {Polynomial} about Return the function of a place that the polynomial is. */
function values({ centre, scale, offset, powers, factors }) {
  return (/** @type {number[]} */ [x, y]) => {
    const u = (x - centre[0]) / scale, v = (y - centre[1]) / scale;
    const terms = powers.map(([i, j]) => u ** i * v ** j);
    return offset.map((first, k) => terms.reduce((sum, term, n) => sum + factors[k][n] * term, first));
  };
}
