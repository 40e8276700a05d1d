// Pictures, points and lines from the server as layers of the map.

const ol = /** @type {any} */ (globalThis).ol;

/**
 * @typedef {object} Picture
 * @property {number[]} bounds
 * @property {string} image
 * @property {string[]} colours
 * @property {string} title
 * @property {string[]} ends
 */

/** @param {any} map @param {{image: string, bounds: number[]}} picture */
function pictureLayer(map, picture) {
  const projection = map.getView().getProjection();
  const source = new ol.source.ImageStatic({ url: picture.image, imageExtent: picture.bounds, projection, interpolate: true });
  return new ol.layer.Image({ opacity: 0.82, zIndex: 7, source });
}

/** @param {number[][]} places @param {string} [color] */
export function pointLayer(places, color = "#332288") {
  const source = new ol.source.Vector({ features: places.map((place) => new ol.Feature(new ol.geom.Point(place))) });
  const stroke = new ol.style.Stroke({ color: "rgba(255,255,255,.8)", width: 1 });
  const image = new ol.style.Circle({ radius: 3, fill: new ol.style.Fill({ color }), stroke });
  return new ol.layer.Vector({ source, zIndex: 11, style: new ol.style.Style({ image }) });
}

/** @param {number[][][]} lines @param {string} color @param {number[]} [lineDash] */
export function lineLayer(lines, color, lineDash) {
  const source = new ol.source.Vector({ features: lines.map((places) => new ol.Feature(new ol.geom.LineString(places))) });
  const halo = new ol.style.Style({ stroke: new ol.style.Stroke({ color: "rgba(255,255,255,.85)", width: 5.5 }) });
  const line = new ol.style.Style({ stroke: new ol.style.Stroke({ color, width: 3, lineDash }) });
  return new ol.layer.Vector({ source, zIndex: 13, style: [halo, line] });
}

/**
 * Show a picture with its legend; one of the same name is replaced.
 * @param {any} map @param {import("./layers.js").Layers} layers @param {string} name @param {string} title @param {Picture} picture
 */
export function showPicture(map, layers, name, title, picture) {
  const layer = pictureLayer(map, picture);
  const legend = () => ({ title, colours: picture.colours, low: picture.ends[0], high: picture.ends[1] });
  layers.add({ name, title, layer, legend, isPicture: true });
  map.addLayer(layer);
}
