// A drive in time: the rovers with their uncertainty, their paths so far, the camera's image and the map at that time.
// While a drive goes on, the latest state is shown until the slider is moved back.
import { element } from "../dom.js";
import { Player } from "../map/player.js";
import { ROVERS } from "../map/route.js";
import { clockText, indexAt } from "../map/drive.js";
import { PictureLayer } from "../map/overlays.js";

/** @typedef {import("../types.js").Place} Place */
/** @typedef {{time_s: number[], places: Place[], true?: Place[], ellipses?: [number, number, number][], images?: [number, number][], battery?: (number|null)[]}} Track
 * Ellipses hold 95 %: half axes [m], and the angle of the first [rad]. Images have a time and a number. */
/** @typedef {{time_s: number, swaths: number, of: number, rmse_m: number, elevation: import("../map/overlays.js").Picture, sigma: import("../map/overlays.js").Picture}} Grown */
const ol = /** @type {any} */ (globalThis).ol;
const STEPS = 1000, CORNERS = 48;

export class Replay {
  /** @type {Track[]} */
  tracks = [];
  /** @type {Grown[]} */
  maps = [];
  imageOf = "";
  timeS = 0;
  isLatest = true;
  isWaiting = false;

  /** @param {any} map @param {import("../map/layers.js").Layers} layers @param {string} name Of the slider and the layers. @param {string} title Of the paths. */
  constructor(map, layers, name, title) {
    this.map = map;
    this.layers = layers;
    this.name = name;
    this.title = title;
    this.source = new ol.source.Vector();
    this.elevation = new PictureLayer(map, layers, `${name}-elevation`, "Map as it grows");
    this.sigma = new PictureLayer(map, layers, `${name}-sigma`, "σ as it grows");
    this.slider = /** @type {HTMLInputElement} */ (element("input", { type: "range", min: "0", max: String(STEPS), step: "1", value: "0", id: name, class: "time", oninput: () => this.#move() }));
    this.label = element("label", { for: name });
    this.camera = /** @type {HTMLImageElement} */ (element("img", { id: `${name}-camera`, class: "camera", alt: "Image of the rover's camera", hidden: true }));
    this.player = new Player(`${name}-play`, () => [this.beginS, this.endS], () => this.timeS, (timeS) => this.#goTo(timeS));
    const close = element("button", { type: "button", class: "quiet", text: "Close the drive", id: `${name}-close`, onclick: () => this.clear() });
    this.controls = element("div", { class: "stack", hidden: true }, this.slider, element("div", { class: "row" }, this.player.button, close));
    this.part = element("div", { class: "stack", hidden: true }, this.camera, this.label, this.controls);
  }

  #empty() {
    this.tracks = [];
    this.maps = [];
    this.imageOf = "";
    this.timeS = 0;
    this.isLatest = true;
  }

  clear() {
    this.player.stop();
    this.#empty();
    this.part.hidden = this.controls.hidden = this.camera.hidden = true;
    this.label.textContent = "";
    this.source.clear(true);
    this.layers.remove(this.name);
    this.elevation.remove();
    this.sigma.remove();
  }

  /** @param {any} event Of a job. @param {string} [job] */
  take(event, job) {
    if (event.kind === "frame") this.#showImage(`/api/jobs/${job}/frame?${event.number}`, `Image ${event.number} of the drive`);
    if (event.kind === "driven") {
      this.tracks = event.rovers;
      this.imageOf = `/api/jobs/${job}/frame?number=`;
      this.camera.hidden = true;
    }
    if (event.kind === "rover") this.#follow(event);
    if (event.kind === "grown") this.maps.push(event);
    if (["driven", "rover", "grown"].includes(event.kind)) this.#later();
  }

  /** @param {{time_s: number, place: Place, battery: number|null}} at */
  #follow(at) {
    const track = (this.tracks[0] ??= { time_s: [], places: [], battery: [] });
    track.time_s.push(at.time_s);
    track.places.push(at.place);
    track.battery?.push(at.battery);
  }

  /** @param {string} address @param {string} [text] */
  #showImage(address, text) {
    if (!this.camera.src.endsWith(address)) this.camera.src = address;
    this.part.hidden = this.camera.hidden = false;
    if (text) this.label.textContent = text;
  }

  get beginS() {
    return this.tracks.reduce((first, { time_s }) => Math.min(first, time_s[0]), Infinity);
  }

  get endS() {
    return this.tracks.reduce((last, { time_s }) => Math.max(last, time_s.at(-1) ?? 0), -Infinity);
  }

  /** Draw once for all events that arrive together. */
  #later() {
    if (this.isWaiting || !this.tracks.length) return;
    this.isWaiting = true;
    requestAnimationFrame(() => {
      this.isWaiting = false;
      if (!this.tracks.length) return;
      if (this.part.hidden || this.controls.hidden) this.#begin();
      this.#show(this.isLatest ? this.endS : this.timeS);
    });
  }

  #begin() {
    this.part.hidden = this.controls.hidden = false;
    const layer = new ol.layer.Vector({ source: this.source, style: styleOf, zIndex: 29 });
    this.layers.add({ name: this.name, title: this.title, layer });
    this.map.addLayer(layer);
  }

  #move() {
    this.player.stop();
    this.#goTo(this.beginS + (Number(this.slider.value) / STEPS) * (this.endS - this.beginS));
  }

  /** @param {number} timeS */
  #goTo(timeS) {
    this.isLatest = timeS >= this.endS - 1e-6;
    this.#show(timeS);
  }

  /** @param {number} timeS */
  #show(timeS) {
    this.timeS = timeS;
    this.slider.value = String(Math.round((STEPS * (timeS - this.beginS)) / (this.endS - this.beginS || 1)));
    const grown = this.maps.findLast((one) => one.time_s <= timeS + 1e-6) ?? null;
    this.elevation.show(grown?.elevation ?? null);
    this.sigma.show(grown?.sigma ?? null);
    this.source.clear(true);
    this.source.addFeatures(this.tracks.flatMap((track, rover) => features(track, rover, timeS)));
    this.label.textContent = this.#text(timeS, grown);
    this.slider.setAttribute("aria-valuetext", this.label.textContent);
    const image = this.tracks[0].images?.findLast(([taken]) => taken <= timeS);
    if (image) this.#showImage(this.imageOf + image[1]);
  }

  /** @param {number} timeS @param {Grown|null} grown */
  #text(timeS, grown) {
    const found = [clockText(timeS - this.beginS)];
    this.tracks.forEach((track, rover) => {
      const index = indexAt(track.time_s, timeS), who = this.tracks.length > 1 ? `rover ${rover + 1} ` : "";
      const radius = track.ellipses?.[index][0], battery = track.battery?.[index] ?? null;
      if (radius !== undefined) found.push(`${who}within ${radius < 10 ? radius.toFixed(2) : radius.toFixed(0)} m (95 %)`);
      if (battery !== null) found.push(`battery ${(100 * battery).toFixed(0)} %`);
    });
    found.push(grown ? `map after ${grown.swaths} of ${grown.of} swaths, expected RMSE ${grown.rmse_m.toFixed(2)} m` : "no map yet");
    return found.join(" · ");
  }
}

/** @param {Track} track @param {number} rover @param {number} timeS Paths until a time, and where the rover is then. */
function features(track, rover, timeS) {
  const index = indexAt(track.time_s, timeS), place = track.places[index];
  const line = (/** @type {Place[]} */ places, /** @type {string} */ kind) => new ol.Feature({ geometry: new ol.geom.LineString(places.slice(0, index + 1)), kind, rover });
  const found = index > 0 ? [...(track.true ? [line(track.true, "true")] : []), line(track.places, "path")] : [];
  const ellipse = track.ellipses?.[index];
  if (ellipse) found.push(new ol.Feature({ geometry: new ol.geom.Polygon([outline(place, ellipse)]), kind: "ellipse", rover }));
  return [...found, new ol.Feature({ geometry: new ol.geom.Point(place), kind: "rover", rover })];
}

/** @param {Place} centre @param {[number, number, number]} ellipse @returns {Place[]} */
function outline([x, y], [long, short, angle]) {
  return Array.from({ length: CORNERS + 1 }, (_, k) => {
    const turn = (2 * Math.PI * k) / CORNERS, along = long * Math.cos(turn), across = short * Math.sin(turn);
    return [x + along * Math.cos(angle) - across * Math.sin(angle), y + along * Math.sin(angle) + across * Math.cos(angle)];
  });
}

/** @param {any} feature */
function styleOf(feature) {
  const kind = feature.get("kind"), color = ROVERS[feature.get("rover") % ROVERS.length];
  if (kind === "true") return new ol.style.Style({ stroke: new ol.style.Stroke({ color: "#ffffff", width: 2.2, lineDash: [7, 5] }) });
  if (kind === "path") return new ol.style.Style({ stroke: new ol.style.Stroke({ color: "#1d2a35", width: 2.2 }) });
  if (kind === "ellipse") return new ol.style.Style({ zIndex: 1, fill: new ol.style.Fill({ color: "rgba(255,255,255,.35)" }), stroke: new ol.style.Stroke({ color, width: 2 }) });
  const image = new ol.style.Circle({ radius: 7, fill: new ol.style.Fill({ color }), stroke: new ol.style.Stroke({ color: "#ffffff", width: 2.5 }) });
  return new ol.style.Style({ zIndex: 2, image });
}
