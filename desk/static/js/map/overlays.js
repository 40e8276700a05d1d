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
function pictureSource(map, picture) {
  const projection = map.getView().getProjection();
  return new ol.source.ImageStatic({ url: picture.image, imageExtent: picture.bounds, projection, interpolate: true });
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
  new PictureLayer(map, layers, name, title).show(picture);
}

/** A picture that changes in time, with its legend; the layer keeps its opacity and whether it is shown. */
export class PictureLayer {
  /** @param {any} map @param {import("./layers.js").Layers} layers @param {string} name @param {string} title */
  constructor(map, layers, name, title) {
    this.map = map;
    this.layers = layers;
    this.name = name;
    this.title = title;
    /** @type {Picture|null} */
    this.shown = null;
    /** @type {any} */
    this.layer = null;
  }

  /** @param {Picture|null} picture None at a time at which there is no picture. */
  show(picture) {
    if (picture === this.shown) return;
    this.shown = picture;
    if (picture && !this.layer) this.#add();
    this.layer?.setSource(picture && pictureSource(this.map, picture));
    this.layers.legends();
  }

  #add() {
    this.layer = new ol.layer.Image({ opacity: 0.82, zIndex: 7 });
    const legend = () => this.shown && { title: this.title, colours: this.shown.colours, low: this.shown.ends[0], high: this.shown.ends[1] };
    this.layers.add({ name: this.name, title: this.title, layer: this.layer, legend, isPicture: true });
    this.map.addLayer(this.layer);
  }

  remove() {
    this.shown = this.layer = null;
    this.layers.remove(this.name);
  }
}
