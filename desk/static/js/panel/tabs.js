// The tabs of the panel.
import { byId, element } from "../dom.js";

/** @param {{name: string, title: string, page: HTMLElement}[]} tabs */
export function createTabs(tabs) {
  const buttons = tabs.map(({ name, title }) =>
    element("button", { type: "button", role: "tab", id: `tab-${name}`, "aria-controls": `page-${name}`, text: title, onclick: () => choose(name) }));
  const pages = tabs.map(({ name, page }) => element("div", { role: "tabpanel", id: `page-${name}`, "aria-labelledby": `tab-${name}`, tabindex: "0" }, page));
  byId("tabs").append(...buttons);
  byId("pages").append(...pages);
  byId("tabs").addEventListener("keydown", (event) => {
    const at = buttons.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (at < 0 || !step) return;
    const next = (at + step + tabs.length) % tabs.length;
    choose(tabs[next].name);
    buttons[next].focus();
  });

  /** @param {string} chosen */
  function choose(chosen) {
    tabs.forEach(({ name }, index) => {
      buttons[index].setAttribute("aria-selected", String(name === chosen));
      buttons[index].tabIndex = name === chosen ? 0 : -1;
      pages[index].hidden = name !== chosen;
    });
    byId("pages").scrollTop = 0;
  }
  choose(tabs[0].name);
  return choose;
}
