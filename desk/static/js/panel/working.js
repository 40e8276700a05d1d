// A button that starts a job, with its progress and a way to give it up.
import { element } from "../dom.js";
import { runJob } from "../server/jobs.js";

export class Working {
  /**
   * @param {"guarantee"|"curve"|"mission"|"map"|"next"|"watch"|"replay"} kind
   * @param {string} title
   * @param {(event: any) => void} follow
   */
  constructor(kind, title, follow) {
    this.kind = kind;
    this.follow = follow;
    this.button = /** @type {HTMLButtonElement} */ (element("button", { type: "button", class: "primary", text: title, id: `start-${kind}`, onclick: () => this.start() }));
    /** @type {Record<string, string>} What the job is about beside the plan. */
    this.about = {};
    this.stop = element("button", { type: "button", text: "Give up", hidden: true, onclick: () => this.running?.cancel() });
    this.bar = element("progress", { max: "1", "aria-label": title, hidden: true });
    this.text = element("p", { class: "note", role: "status", id: `status-${kind}` });
    this.part = element("div", { class: "stack" }, element("div", { class: "row" }, this.button, this.stop), this.bar, this.text);
    /** @type {import("../server/jobs.js").Running|null} */
    this.running = null;
  }

  async start() {
    this.#busy(true);
    this.text.textContent = "Starting …";
    this.follow({ kind: "started" });
    try {
      this.running = await runJob(this.kind, (event) => this.#show(event), this.about);
    } catch (error) {
      this.#show({ kind: "refused", error: error instanceof Error ? error.message : String(error) });
    }
  }

  /** @param {any} event */
  #show(event) {
    const isOver = ["done", "refused", "cancelled"].includes(event.kind);
    if (isOver) this.#busy(false);
    if (event.total) /** @type {HTMLProgressElement} */ (this.bar).value = event.done / event.total;
    const texts = /** @type {Record<string, string>} */ ({ refused: event.error, cancelled: "Given up.", done: "", stage: `${event.stage} …`, progress: `${event.what} …` });
    if (event.kind in texts) this.text.textContent = texts[event.kind];
    this.follow(event);
  }

  /** @param {boolean} isBusy */
  #busy(isBusy) {
    this.button.disabled = isBusy;
    this.stop.hidden = this.bar.hidden = !isBusy;
    if (!isBusy) this.running = null;
    if (isBusy) this.bar.removeAttribute("value");
  }
}
