// Numbers of the plan: predicted error first, then length, time, energy, turns.
import { byId, element } from "../dom.js";

/** @typedef {import("../types.js").PlanSummary} PlanSummary */
const SHOWN = ["length_m", "time_s", "energy_j", "n_turns", "n_recharges", "transit_share", "left_out_share"];

/** @param {PlanSummary|null} plan */
export function showFacts(plan) {
  if (!plan) return byId("facts").replaceChildren();
  const by = new Map(plan.facts.map((fact) => [fact.name, fact]));
  const rmse = by.get("rmse_m");
  const [, value, bounds] = /^([^(]*[^( ])(?: (\(.*\)))?$/.exec(rmse?.text ?? "…") ?? [];
  const main = element("div", { class: "fact main" },
    element("span", { text: rmse ? "Predicted RMSE of the map" : plan.no_error_because || "Predicted error follows" }),
    element("b", { id: "rmse" }, value, ...(bounds ? [" ", element("small", { text: bounds })] : [])),
    element("span", { id: "swaths", text: plan.spacing_m ? `${plan.swaths}, ${plan.spacing_m.toPrecision(3)} m apart` : plan.swaths }));
  const cells = SHOWN.flatMap((name) => {
    const fact = by.get(name);
    if (!fact || ((name === "left_out_share" || name === "n_recharges") && fact.value === 0)) return [];
    return [cell(fact.title, short(name, fact.text), name)];
  });
  cells.push(cell("area", plan.area_m2 < 1e5 ? `${plan.area_m2.toFixed(0)} m²` : `${(plan.area_m2 / 1e6).toFixed(3)} km²`, "area"));
  byId("facts").replaceChildren(main, ...cells, ...leftOut(plan));
  byId("facts").classList.toggle("provisional", plan.is_provisional);
  return undefined;
}

/** @param {PlanSummary} plan */
function leftOut(plan) {
  if (!plan.left_out.length) return [];
  const places = plan.left_out.map((piece) => element("li", { text: piece.text }));
  return [element("details", { class: "left-out" }, element("summary", { text: "What is left out, and why" }), element("ul", { tabindex: "0", "aria-label": "What is left out" }, ...places))];
}

/** @param {string} name @param {string} text */
function short(name, text) {
  return name.endsWith("_share") ? text.split(" ")[0] : text;
}

/** @param {string} title @param {string} text @param {string} name */
function cell(title, text, name) {
  return element("div", { class: "fact" }, element("b", { text, id: `fact-${name}` }), element("span", { text: title.charAt(0).toUpperCase() + title.slice(1) }));
}
