// The route on the map: swaths, transits, direction, ground that is left out.

/** @typedef {import("../types.js").PlanSummary} PlanSummary */
const ol = /** @type {any} */ (globalThis).ol;

/** Colours of rovers, as in the figures of reports; they differ for colour-blind people too. */
export const ROVERS = ["#d55e00", "#0072b2", "#009e73", "#aa4499", "#b58900", "#332288"];

export class RouteLayer {
  constructor() {
    this.source = new ol.source.Vector();
    this.layer = new ol.layer.Vector({ source: this.source, style: styles, zIndex: 12 });
  }

  /** @param {PlanSummary|null} plan */
  show(plan) {
    this.source.clear(true);
    if (!plan) return;
    const lines = plan.legs.map((leg) => new ol.Feature({ geometry: new ol.geom.LineString(leg.places), kind: leg.kind, rover: leg.rover }));
    const pieces = plan.left_out.map((piece) => new ol.Feature({ geometry: new ol.geom.Polygon(piece.rings.map((ring) => [...ring, ring[0]])), kind: "left-out" }));
    this.source.addFeatures([...pieces, ...lines, ...ends(plan.legs)]);
  }
}

/** @param {import("../types.js").Leg[]} legs Return where each rover begins and ends. */
function ends(legs) {
  const rovers = [...new Set(legs.map((leg) => leg.rover))];
  return rovers.flatMap((rover) => {
    const own = legs.filter((leg) => leg.rover === rover);
    const places = /** @type {[string, import("../types.js").Place|undefined][]} */ ([["begin", own[0].places[0]], ["end", own.at(-1)?.places.at(-1)]]);
    return places.map(([kind, place]) => new ol.Feature({ geometry: new ol.geom.Point(place), kind, rover }));
  });
}

/** @param {string} kind @param {string} color */
function endStyle(kind, color) {
  const fill = new ol.style.Fill({ color: kind === "begin" ? color : "#ffffff" });
  const stroke = new ol.style.Stroke({ color: kind === "begin" ? "#ffffff" : color, width: 2.5 });
  return new ol.style.Style({ zIndex: 2, image: new ol.style.Circle({ radius: kind === "begin" ? 7 : 6, fill, stroke }) });
}

/** @param {any} feature @param {number} resolution */
function styles(feature, resolution) {
  const kind = feature.get("kind");
  if (kind === "begin" || kind === "end") return endStyle(kind, ROVERS[feature.get("rover") % ROVERS.length]);
  if (kind === "left-out")
    return new ol.style.Style({
      fill: new ol.style.Fill({ color: "rgba(60,60,60,.35)" }),
      stroke: new ol.style.Stroke({ color: "#3c3c3c", width: 1, lineDash: [3, 3] }),
    });
  const colour = ROVERS[feature.get("rover") % ROVERS.length];
  const dash = kind === "transit" ? [2, 6] : undefined;
  const line = new ol.style.Stroke({ color: colour, width: kind === "transit" ? 2 : 2.6, lineDash: dash, lineCap: "round" });
  const halo = new ol.style.Stroke({ color: "rgba(255,255,255,.75)", width: 4.6 });
  const drawn = [new ol.style.Style({ stroke: halo }), new ol.style.Style({ stroke: line })];
  return kind === "swath" ? [...drawn, ...arrow(feature.getGeometry(), colour, resolution)] : drawn;
}

/** @param {any} line @param {string} colour @param {number} resolution */
function arrow(line, colour, resolution) {
  if (line.getLength() / resolution < 60) return [];
  const [before, at] = [line.getCoordinateAt(0.49), line.getCoordinateAt(0.51)];
  const rotation = Math.atan2(at[0] - before[0], at[1] - before[1]);
  const shape = new ol.style.RegularShape({
    points: 3, radius: 7, rotation, rotateWithView: true, fill: new ol.style.Fill({ color: colour }),
    stroke: new ol.style.Stroke({ color: "#ffffff", width: 1.2 }),
  });
  return [new ol.style.Style({ geometry: new ol.geom.Point(at), image: shape })];
}
