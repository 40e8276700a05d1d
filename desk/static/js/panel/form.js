// Forms of settings, made from the fields that the server describes: name, unit, limits, help.
import { element } from "../dom.js";

/** @typedef {import("../types.js").Field} Field */

/** @type {[RegExp, string][]} */
const UNITS = [[/_deg$/, "°"], [/_m_s$/, "m/s"], [/_m$/, "m"], [/_s$/, "s"], [/_j$/, "J"], [/_kg$/, "kg"], [/_w$/, "W"], [/_share$/, "×"]];

/** @param {string} name */
export function unitOf(name) {
  return UNITS.find(([ending]) => ending.test(name))?.[1] ?? "";
}

/** @param {string} name */
export function titleOf(name) {
  const bare = name.replace(/_(deg|m_s|m|s|j|kg|w|share)$/, "").replaceAll("_", " ");
  return bare.charAt(0).toUpperCase() + bare.slice(1);
}

/**
 * Create a labelled input.
 * @param {string} section
 * @param {Field} field
 * @param {any} value Undefined where the default holds.
 * @param {(value: any) => void} changed Called with undefined where the input is emptied.
 * @param {string} [title]
 */
export function fieldRow(section, field, value, changed, title = titleOf(field.name)) {
  const id = `${section}-${field.name}`;
  const input = field.kind === "boolean" ? checkbox(id, value ?? field.default, changed)
    : field.kind === "choice" ? choice(id, field, value, changed)
    : field.kind === "text" ? text(id, field, value, changed)
    : number(id, field, value, changed);
  (input.querySelector("input") ?? input).setAttribute("aria-describedby", `${id}-help`);
  return element(
    "div", { class: "field" },
    element("label", { for: id, text: title }),
    element("span", { class: "input" }, input, element("span", { class: "unit", text: unitOf(field.name) })),
    element("span", { class: "help", id: `${id}-help`, text: field.help }),
  );
}

/** @param {string} id @param {boolean} value @param {(value: any) => void} changed */
function checkbox(id, value, changed) {
  return element("input", { type: "checkbox", id, checked: Boolean(value), onchange: (/** @type {any} */ event) => changed(event.target.checked) });
}

/** @param {string} id @param {Field} field @param {any} value @param {(value: any) => void} changed */
function choice(id, field, value, changed) {
  const none = field.default === null ? [element("option", { value: "", text: "automatic" })] : [];
  const options = field.choices.map((name) => element("option", { value: name, text: name, selected: name === (value ?? field.default) }));
  return element("select", { id, onchange: (/** @type {any} */ event) => changed(event.target.value || undefined) }, ...none, ...options);
}

/** @param {string} id @param {Field} field @param {any} value @param {(value: any) => void} changed */
function text(id, field, value, changed) {
  const list = element("datalist", { id: `${id}-list` }, ...field.choices.map((name) => element("option", { value: name })));
  const input = element("input", { type: "text", id, list: `${id}-list`, maxlength: "40", value: value ?? "", placeholder: "not set", onchange: (/** @type {any} */ event) => changed(event.target.value.trim() || undefined) });
  return element("span", { class: "input" }, input, list);
}

/** @param {string} id @param {Field} field @param {any} value @param {(value: any) => void} changed */
function number(id, field, value, changed) {
  const isWhole = field.kind === "integer";
  const placeholder = field.default === null || field.default === undefined ? "not set" : String(field.default);
  const input = /** @type {HTMLInputElement} */ (
    element("input", { type: "number", id, step: isWhole ? "1" : "any", placeholder, value: value === undefined || value === null ? "" : String(value) })
  );
  input.addEventListener("change", () => {
    const given = input.value.trim();
    const parsed = Number(given);
    const isBad = input.validity.badInput || (given !== "" && !(Number.isFinite(parsed) && (!isWhole || Number.isInteger(parsed))));
    input.setAttribute("aria-invalid", String(isBad));
    if (!isBad) changed(given === "" ? undefined : parsed);
  });
  return input;
}
