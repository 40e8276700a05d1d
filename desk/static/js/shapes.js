// The drawn polygons and starts as features of the map, and back.

/** @typedef {import("./types.js").PlanDocument} PlanDocument */
const ol = /** @type {any} */ (globalThis).ol;

const OUTLINE = "#0b3d5c";
const NO_GO = "#b3262b";

/** @param {string} colour @param {string} fill @param {number} width */
const stroked = (colour, fill, width) => [
  new ol.style.Style({ stroke: new ol.style.Stroke({ color: "rgba(255,255,255,.85)", width: width + 2.5 }) }),
  new ol.style.Style({ stroke: new ol.style.Stroke({ color: colour, width }), fill: new ol.style.Fill({ color: fill }) }),
];
const marker = (/** @type {boolean} */ selected) =>
  new ol.style.Style({
    image: new ol.style.RegularShape({
      points: 3, radius: selected ? 12 : 9, fill: new ol.style.Fill({ color: "#ffffff" }),
      stroke: new ol.style.Stroke({ color: OUTLINE, width: 2.5 }),
    }),
  });

/** @param {any} feature @param {boolean} selected */
export function styleOf(feature, selected) {
  const role = feature.get("role");
  if (role === "starts") return marker(selected);
  if (role === "no_go") return stroked(NO_GO, "rgba(179,38,43,.22)", selected ? 3.5 : 2);
  return stroked(OUTLINE, "rgba(255,255,255,.01)", selected ? 4 : 2.5);
}

/** @param {PlanDocument} document */
export function featuresOf(document) {
  const polygon = (/** @type {any} */ rings) =>
    new ol.geom.Polygon(rings.map((/** @type {any} */ ring) => [...ring, ring[0]]));
  return [
    ...document.areas.map((rings, index) => feature(polygon(rings), "areas", index)),
    ...document.no_go.map((rings, index) => feature(polygon(rings), "no_go", index)),
    ...document.starts.map((place, index) => feature(new ol.geom.Point(place), "starts", index)),
  ];
}

/** @param {any} geometry @param {string} role @param {number} index */
function feature(geometry, role, index) {
  const made = new ol.Feature({ geometry, role, index });
  made.setId(`${role}-${index}`);
  return made;
}

/**
 * Return what is drawn, as a part of the document: millimetres are enough.
 * @param {any} geometry
 */
export function placesOf(geometry) {
  const rounded = (/** @type {number[]} */ [x, y]) => [Math.round(x * 1000) / 1000, Math.round(y * 1000) / 1000];
  if (geometry.getType() === "Point") return rounded(geometry.getCoordinates());
  return geometry.getCoordinates().map((/** @type {number[][]} */ ring) => ring.slice(0, -1).map(rounded));
}
