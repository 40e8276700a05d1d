// The predicted standard deviation of the map over the terrain.

/** @typedef {import("../types.js").ErrorMap} ErrorMap */
const ol = /** @type {any} */ (globalThis).ol;

export class ErrorLayer {
  /** @param {any} projection */
  constructor(projection) {
    this.projection = projection;
    this.layer = new ol.layer.Image({ opacity: 0.72, zIndex: 6 });
    /** @type {ErrorMap|null} */
    this.shown = null;
  }

  /** @param {ErrorMap|null} found */
  show(found) {
    this.shown = found;
    const source = found?.image
      ? new ol.source.ImageStatic({ url: found.image, imageExtent: found.bounds, projection: this.projection, interpolate: true })
      : null;
    this.layer.setSource(source);
  }
}
