// Elements of the page.

/**
 * Create an element.
 * @param {string} name
 * @param {Record<string, any>} [attributes] `on…` are listeners, `text` is the content; true and false set and leave out.
 * @param {...(Node|string)} children
 * @returns {HTMLElement}
 */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (key === "text") made.textContent = value;
    else if (key in made && typeof value !== "string") /** @type {any} */ (made)[key] = value;
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

/**
 * Return an element of the page.
 * @param {string} id
 * @returns {HTMLElement}
 */
export function byId(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element ${id}`);
  return found;
}

const PATHS = {
  select: "M5 3l13 9-6 1.5L9 20z",
  area: "M4 7l9-4 7 6-3 10-11 1z",
  hole: "M3 5h18v14H3zM9 9h6v6H9z",
  no_go: "M12 3a9 9 0 100 18 9 9 0 000-18zM6 6l12 12",
  start: "M6 21V4h11l-2.5 4L17 12H6",
  stake: "M12 21V5M12 5l6 3-6 3M8 21h8",
  checkpoint: "M12 3l8 9-8 9-8-9zM8.5 12l2.5 2.5 4-5",
  measure: "M3 16L16 3l5 5L8 21zM8 11l2 2M11 8l2 2",
  remove: "M4 7h16M9 7V4h6v3M7 7l1 13h8l1-13",
  zoomIn: "M12 5v14M5 12h14",
  zoomOut: "M5 12h14",
  fit: "M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5",
  open: "M3 7h6l2 2h10v10H3zM12 17v-5M9.5 14L12 11.5 14.5 14",
  drive: "M3 19h18M3 16l5-7 4 4 4-8 5 9",
  undo: "M9 14L4 9l5-5M4 9h9a6 6 0 010 12h-2",
  redo: "M15 14l5-5-5-5M20 9h-9a6 6 0 000 12h2",
};

/**
 * Return a picture for a button.
 * @param {keyof typeof PATHS} name
 * @returns {SVGElement}
 */
export function icon(name) {
  const space = "http://www.w3.org/2000/svg";
  const picture = document.createElementNS(space, "svg");
  picture.setAttribute("viewBox", "0 0 24 24");
  picture.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(space, "path");
  path.setAttribute("d", PATHS[name]);
  picture.append(path);
  return picture;
}

/**
 * Return a button with a picture and a name that is read and shown on hover.
 * @param {keyof typeof PATHS} name
 * @param {string} title
 * @param {() => void} action
 * @returns {HTMLButtonElement}
 */
export function iconButton(name, title, action) {
  const made = element("button", { type: "button", title, "aria-label": title, onclick: action }, icon(name));
  return /** @type {HTMLButtonElement} */ (made);
}
