// The plan as it follows the document: route at once, error coarse and then fine; outdated answers are dropped.
import { get, Refusal } from "./api.js";

/** @typedef {import("./plan.js").Plan} Plan */

export class Live extends EventTarget {
  /** @param {Plan} plan */
  constructor(plan) {
    super();
    this.plan = plan;
    this.abort = new AbortController();
    plan.addEventListener("change", () => this.refresh());
  }

  async refresh() {
    this.abort.abort();
    this.abort = new AbortController();
    const { signal } = this.abort;
    document.documentElement.dataset.busy = "yes";
    try {
      await this.#follow(this.plan.revision, signal);
    } catch (error) {
      if (signal.aborted || (error instanceof Refusal && error.status === 409)) return;
      this.#announce("refused", error instanceof Error ? error.message : String(error));
    }
    if (!signal.aborted) delete document.documentElement.dataset.busy;
  }

  /** @param {number} revision @param {AbortSignal} signal */
  async #follow(revision, signal) {
    const route = await get(`/api/route?revision=${revision}`, signal);
    this.#announce("route", route);
    await this.#errorOf(route, "", signal);
    if (!route.is_provisional) return;
    const exact = await get(`/api/route?revision=${revision}&exact=1`, signal);
    this.#announce("route", exact);
    await this.#errorOf(exact, "&exact=1", signal);
  }

  /**
   * Show the error coarse at once, and fine after.
   * @param {import("../types.js").PlanSummary} route @param {string} exact @param {AbortSignal} signal
   */
  async #errorOf(route, exact, signal) {
    if (!route.has_error) {
      if (!route.is_provisional) this.#announce("error", null);
      return;
    }
    for (const detail of ["coarse", "fine"])
      this.#announce("error", await get(`/api/error?revision=${route.revision}&detail=${detail}${exact}`, signal));
  }

  /** @param {string} name @param {unknown} detail */
  #announce(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
