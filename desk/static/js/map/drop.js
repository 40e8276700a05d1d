// Files dropped onto the page: outlines become shapes of the plan, rasters become layers, points become the measured points.
import { post } from "../server/api.js";
import { showPicture } from "./overlays.js";
import { byId, element } from "../dom.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
/** @typedef {import("./layers.js").Layers} Layers */

/**
 * @param {any} map @param {Plan} plan @param {Layers} layers @param {(file: File) => Promise<void>} takePoints
 * @param {(sentence: string) => void} refuse
 */
export function acceptFiles(map, plan, layers, takePoints, refuse) {
  let n = 0;
  const take = async (/** @type {File[]} */ files) => {
    for (const file of files) {
      try {
        const place = `/api/dropped?name=${encodeURIComponent(file.name)}`;
        let found = await post(place, file);
        refuse("");
        if (found.kind === "choices") {
          const select = await chosenOutline(file.name, found.choices);
          if (select === "") continue;
          found = await post(`${place}&select=${encodeURIComponent(select)}`, file);
        }
        if (found.kind === "outline") await takeOutline(plan, found.document, file.name);
        else if (found.kind === "points") await takePoints(file);
        else addLayer(map, layers, found, file.name, ++n);
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

/**
 * Ask which outline of a file with many is meant; the empty text stands for none.
 * @param {string} name @param {{title: string, select: string}[]} choices @returns {Promise<string>}
 */
function chosenOutline(name, choices) {
  const options = choices.map(({ title, select }) => element("option", { value: select }, title));
  const list = element("select", { id: "outline-choice", size: String(Math.min(12, options.length)), "aria-label": "Outlines of the file" }, ...options);
  const take = element("button", { type: "submit", value: "take" }, "Add");
  const leave = element("button", { type: "submit", value: "" }, "Cancel");
  const form = element("form", { method: "dialog" }, element("p", {}, `${name} holds ${choices.length} outlines. Which one is to be surveyed?`), list, take, leave);
  const dialog = /** @type {any} */ (element("dialog", { id: "outlines" }, form));
  document.body.append(dialog);
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      resolve(dialog.returnValue === "take" ? /** @type {any} */ (list).value : "");
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
