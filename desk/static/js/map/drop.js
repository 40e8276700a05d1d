// Files dropped onto the page: outlines become shapes of the plan, rasters and points become layers.
import { post } from "../server/api.js";
import { pictureLayer, pointLayer } from "./overlays.js";
import { byId, element } from "../dom.js";

/** @typedef {import("../server/plan.js").Plan} Plan */
/** @typedef {import("./layers.js").Layers} Layers */

/** @param {any} map @param {Plan} plan @param {Layers} layers @param {(sentence: string) => void} refuse */
export function acceptFiles(map, plan, layers, refuse) {
  let n = 0;
  const take = async (/** @type {File[]} */ files) => {
    for (const file of files) {
      try {
        const found = await post(`/api/dropped?name=${encodeURIComponent(file.name)}`, file);
        refuse("");
        if (found.kind === "outline") await takeOutline(plan, found.document, file.name);
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
  const layer = found.kind === "raster" ? pictureLayer(map, found) : pointLayer(found.places);
  map.addLayer(layer);
  const limits = found.limits?.map((/** @type {number} */ value) => value.toPrecision(4));
  const legend = () => (found.kind === "raster" ? { title: name, colours: found.colours, low: limits[0], high: limits[1] } : null);
  layers.add({ name: `dropped-${n}`, title: name, layer, legend, isPicture: found.kind === "raster" });
}
