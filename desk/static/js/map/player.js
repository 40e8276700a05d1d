// A button that lets time run.
import { element } from "../dom.js";

const PLAY_S = 24;

export class Player {
  /**
   * @param {string} id
   * @param {() => [number, number]} span Begin and end [s].
   * @param {() => number} now Time that is shown [s].
   * @param {(timeS: number) => void} show
   */
  constructor(id, span, now, show) {
    this.span = span;
    this.now = now;
    this.show = show;
    this.button = /** @type {HTMLButtonElement} */ (element("button", { type: "button", id, text: "▶ Play", onclick: () => this.#play() }));
  }

  #play() {
    if (this.timer !== undefined) return this.stop();
    const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const everyMs = isStill ? 1000 : 40;
    this.button.textContent = "❚❚ Pause";
    const [begin, end] = this.span();
    const step = (end - begin) * (everyMs / 1000 / PLAY_S);
    if (this.now() >= end) this.show(begin);
    this.timer = window.setInterval(() => {
      const next = Math.min(this.now() + step, this.span()[1]);
      this.show(next);
      if (next >= this.span()[1]) this.stop();
    }, everyMs);
    return undefined;
  }

  stop() {
    clearInterval(this.timer);
    /** @type {number|undefined} */
    this.timer = undefined;
    this.button.textContent = "▶ Play";
  }
}
