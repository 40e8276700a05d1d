// The drawn polygons and starts as features of the map, and back.

/** @typedef {import("../types.js").PlanDocument} PlanDocument */
const ol = /** @type {any} */ (globalThis).ol;

const OUTLINE = "#0b3d5c";
const NO_GO = "#b3262b";

/** @param {string} colour @param {string} fill @param {number} width */
const stroked = (colour, fill, width) => [
  new ol.style.Style({ stroke: new ol.style.Stroke({ color: "rgba(255,255,255,.85)", width: width + 2.5 }) }),
  new ol.style.Style({ stroke: new ol.style.Stroke({ color: colour, width }), fill: new ol.style.Fill({ color: fill }) }),
];
/** Points of the plan: number of corners, angle and colour of their marks. */
export const MARKS = /** @type {Record<string, {title: string, points: number, angle: number, colour: string}>} */ ({
  starts: { title: "Start", points: 3, angle: 0, colour: OUTLINE },
  stakes: { title: "Stake", points: 4, angle: Math.PI / 4, colour: "#7a3e9d" },
  checkpoints: { title: "Checkpoint", points: 4, angle: 0, colour: "#0b6b50" },
});

/** @param {string} role @param {number} index @param {boolean} selected */
function marker(role, index, selected) {
  const { points, angle, colour } = MARKS[role];
  const stroke = new ol.style.Stroke({ color: colour, width: 2.5 });
  const image = new ol.style.RegularShape({ points, angle, radius: selected ? 12 : 9, fill: new ol.style.Fill({ color: selected ? "#ffe9a8" : "#ffffff" }), stroke });
  if (role === "starts") return new ol.style.Style({ image });
  const halo = new ol.style.Stroke({ color: "#ffffff", width: 3 });
  const text = new ol.style.Text({ text: String(index + 1), offsetY: -16, font: "600 12px system-ui, sans-serif", fill: new ol.style.Fill({ color: colour }), stroke: halo });
  return new ol.style.Style({ image, text });
}

/** @param {any} feature @param {boolean} selected */
export function styleOf(feature, selected) {
  const role = feature.get("role");
  if (role in MARKS) return marker(role, feature.get("index"), selected);
  if (role === "no_go") return stroked(NO_GO, "rgba(179,38,43,.22)", selected ? 3.5 : 2);
  return stroked(OUTLINE, "rgba(255,255,255,.01)", selected ? 4 : 2.5);
}

/** @param {PlanDocument} document */
export function featuresOf(document) {
  const polygon = (/** @type {any} */ rings) =>
    new ol.geom.Polygon(rings.map((/** @type {any} */ ring) => [...ring, ring[0]]));
  return [
    ...document.areas.map((rings, index) => named(polygon(rings), "areas", index)),
    ...document.no_go.map((rings, index) => named(polygon(rings), "no_go", index)),
    ...Object.keys(MARKS).flatMap((role) =>
      /** @type {any} */ (document)[role].map((/** @type {number[]} */ place, /** @type {number} */ index) => named(new ol.geom.Point(place), role, index))),
  ];
}

/** @param {any} geometry @param {string} role @param {number} index */
function named(geometry, role, index) {
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
