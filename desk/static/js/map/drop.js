// Files dropped onto the page: outlines become shapes of the plan, elevations become layers, pictures the background, points the measured points.
import { post } from "../server/api.js";
import { showBackground } from "./background.js";
import { showPicture } from "./overlays.js";
import { byId, element } from "../dom.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
const ol = /** @type {any} */ (globalThis).ol;
/** @typedef {import("./layers.js").Layers} Layers */

/**
 * @param {any} map @param {Plan} plan @param {Layers} layers @param {(file: File) => Promise<void>} takePoints
 * @param {(sentence: string) => void} refuse @param {(extent: number[]) => void} zoomTo
 */
export function acceptFiles(map, plan, layers, takePoints, refuse, zoomTo) {
  let n = 0;
  const take = async (/** @type {File[]} */ files) => {
    for (const file of files) {
      try {
        const place = `/api/dropped?name=${encodeURIComponent(file.name)}`;
        let found = await post(place, file);
        refuse("");
        if (found.kind === "choices") {
          const chosen = await chosenOutlines(file.name, found.choices);
          if (!chosen.length) continue;
          found = await post(place + chosen.map((select) => `&select=${encodeURIComponent(select)}`).join(""), file);
        }
        if (found.kind === "either") {
          const kind = await chosenKind(file.name);
          if (!kind) continue;
          found = kind === "elevations" ? await post(`${place}&select=elevations`, file) : { kind };
        }
        if (found.kind === "picture") {
          showBackground(map, layers, await post(`/api/background?name=${encodeURIComponent(file.name)}`, file));
          continue;
        }
        if (found.kind === "outline") await takeOutline(plan, found.document, file.name);
        else if (found.kind === "points") await takePoints(file);
        else addLayer(map, layers, found, file.name, ++n);
        zoomTo(extentOf(found));
      } catch (error) {
        refuse(error instanceof Error ? error.message : String(error));
      }
    }
  };
  const hasFiles = (/** @type {DragEvent} */ event) => event.dataTransfer?.types.includes("Files") ?? false;
  document.addEventListener("dragover", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    document.body.classList.add("dropping");
  });
  document.addEventListener("dragleave", (event) => event.relatedTarget === null && document.body.classList.remove("dropping"));
  document.addEventListener("drop", (event) => {
    document.body.classList.remove("dropping");
    if (!hasFiles(event)) return;
    event.preventDefault();
    take([...(event.dataTransfer?.files ?? [])]);
  });
  const chooser = element("input", { type: "file", id: "open-file", class: "hidden", multiple: true, tabindex: "-1", "aria-hidden": "true", onchange: (/** @type {any} */ event) => take([...event.target.files]).then(() => (event.target.value = "")) });
  byId("panel").append(chooser);
  return () => chooser.click();
}

/** @param {any} found Return the bounds of what a file holds. */
function extentOf(found) {
  if (found.bounds) return found.bounds;
  const places = found.places ?? Object.values(found.document).flat(3).flat();
  return ol.extent.boundingExtent(found.places ? places : pairs(places));
}

/** @param {number[]} numbers */
const pairs = (numbers) => Array.from({ length: numbers.length / 2 }, (_, k) => [numbers[2 * k], numbers[2 * k + 1]]);

/**
 * Ask which outlines of a file with several are meant.
 * @param {string} name @param {{title: string, select: string}[]} choices @returns {Promise<string[]>}
 */
function chosenOutlines(name, choices) {
  const options = choices.map(({ title, select }, index) => element("option", { value: select, selected: index === 0 }, title));
  const list = element("select", { id: "outline-choice", multiple: true, size: String(Math.min(12, options.length)), "aria-label": "Outlines of the file" }, ...options);
  const take = element("button", { type: "submit", value: "take" }, "Add");
  const leave = element("button", { type: "submit", value: "" }, "Cancel");
  const form = element("form", { method: "dialog" }, element("p", {}, `${name} holds ${choices.length - 1} outlines. Which are to be surveyed? Ctrl and click chooses several.`), list, take, leave);
  return answerOf(form, "outlines").then((answer) => (answer === "take" ? [.../** @type {any} */ (list).selectedOptions].map((option) => option.value) : []));
}

/** @param {string} name Ask what a raster of one band holds. */
function chosenKind(name) {
  const buttons = [["elevations", "Elevations"], ["picture", "A picture"]].map(([value, text]) => element("button", { type: "submit", value }, text));
  const form = element("form", { method: "dialog" }, element("p", {}, `${name} has one band. Does it hold elevations in metres, or a picture of the ground?`), element("div", { class: "row" }, ...buttons));
  return answerOf(form, "raster-kind");
}

/** @param {HTMLElement} form @param {string} id @returns {Promise<string>} Value of the button that was pressed; empty without one. */
function answerOf(form, id) {
  const dialog = /** @type {any} */ (element("dialog", { id }, form));
  document.body.append(dialog);
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      resolve(dialog.returnValue);
      dialog.remove();
    });
  });
}

/** @param {Plan} plan @param {any} found @param {string} name */
function takeOutline(plan, found, name) {
  return plan.edit(`Add the shapes of ${name}`, (document) => {
    document.areas.push(...found.areas);
    document.no_go.push(...found.no_go);
    document.starts.push(...found.starts);
  });
}

/** @param {any} map @param {Layers} layers @param {any} found @param {string} name @param {number} n */
function addLayer(map, layers, found, name, n) {
  const ends = found.limits.map((/** @type {number} */ value) => value.toPrecision(4));
  showPicture(map, layers, `dropped-${n}`, name, { ...found, ends });
}
