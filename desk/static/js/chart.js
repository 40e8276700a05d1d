// Small line charts as SVG.

const SPACE = "http://www.w3.org/2000/svg";
const WIDTH = 352, HEIGHT = 190, LEFT = 46, RIGHT = 12, TOP = 12, BOTTOM = 34;

/** @param {string} name @param {Record<string, string|number>} attributes @param {string} [text] */
export function svg(name, attributes, text) {
  const made = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  if (text !== undefined) made.textContent = text;
  return made;
}

/**
 * Return round numbers across a range.
 * @param {number} low @param {number} high @param {number} n
 */
export function ticks(low, high, n) {
  const rough = (high - low || 1) / n;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10) * power;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
}

/**
 * @typedef {object} Axes
 * @property {SVGElement} picture
 * @property {(value: number) => number} x
 * @property {(value: number) => number} y
 * @property {(value: number) => number} xAt
 */

/**
 * Create a chart with its axes.
 * @param {{title: string, xTitle: string, yTitle: string, xs: [number, number], ys: [number, number], width?: number, height?: number}} about
 * @returns {Axes}
 */
export function chart(about) {
  const width = about.width ?? WIDTH, height = about.height ?? HEIGHT;
  const [[x0, x1], [y0, y1]] = [about.xs, about.ys];
  const x = (/** @type {number} */ value) => LEFT + ((value - x0) / (x1 - x0 || 1)) * (width - LEFT - RIGHT);
  const y = (/** @type {number} */ value) => height - BOTTOM - ((value - y0) / (y1 - y0 || 1)) * (height - TOP - BOTTOM);
  const xAt = (/** @type {number} */ pixel) => x0 + ((pixel - LEFT) / (width - LEFT - RIGHT)) * (x1 - x0);
  const picture = /** @type {SVGElement} */ (svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": about.title, class: "chart" }));
  for (const value of ticks(y0, y1, 4)) {
    picture.append(svg("line", { x1: LEFT, x2: width - RIGHT, y1: y(value), y2: y(value), class: "grid" }));
    picture.append(svg("text", { x: LEFT - 6, y: y(value) + 4, "text-anchor": "end" }, String(Number(value.toPrecision(4)))));
  }
  for (const value of ticks(x0, x1, 5)) picture.append(svg("text", { x: x(value), y: height - BOTTOM + 15, "text-anchor": "middle" }, String(Number(value.toPrecision(5)))));
  picture.append(svg("text", { x: width - RIGHT, y: height - 4, "text-anchor": "end", class: "axis" }, about.xTitle));
  picture.append(svg("text", { x: 2, y: 10, class: "axis" }, about.yTitle));
  return { picture, x, y, xAt };
}

/** @param {[number, number][]} places Pixels. */
export function pathOf(places) {
  return places.map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
}
