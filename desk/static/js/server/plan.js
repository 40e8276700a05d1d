// The plan document: every change goes to the server, which stores it, and comes back as the new state.
import { get, post, Refusal } from "./api.js";

/** @typedef {import("../types.js").PlanDocument} PlanDocument */

export class Plan extends EventTarget {
  constructor() {
    super();
    /** @type {PlanDocument} */
    this.document = { areas: [], no_go: [], starts: [], stakes: [], checkpoints: [], planner: {}, rover: {}, fleet: {}, requirement: {}, simulation: {}, notes: "", measured: {} };
    this.revision = -1;
    /** @type {string|null} */
    this.undoTitle = null;
    /** @type {string|null} */
    this.redoTitle = null;
    /** @type {string[]} Names of the plans that are set aside. */
    this.variants = [];
    /** @type {Promise<void>} */
    this.last = Promise.resolve();
  }

  /** Show what the server has stored. @param {Promise<any>} [stored] Its answer, where it was asked before. */
  load(stored) {
    return this.#queue(async () => this.#take(await (stored ?? get("/api/plan"))));
  }

  /**
   * Change the document.
   * @param {string} title What is done, for undo.
   * @param {(document: PlanDocument) => void} change Changes a copy.
   */
  edit(title, change) {
    return this.#queue(async () => {
      const document = structuredClone(this.document);
      change(document);
      this.#take(await post("/api/edit", { revision: this.revision, title, document }));
    });
  }

  undo() {
    return this.#queue(async () => this.#take(await post("/api/undo", { revision: this.revision })));
  }

  redo() {
    return this.#queue(async () => this.#take(await post("/api/redo", { revision: this.revision })));
  }

  /** @param {() => Promise<void>} work One after the other, so that no edit is made of an old state. */
  #queue(work) {
    this.last = this.last.then(work).catch((error) => this.#refused(error));
    return this.last;
  }

  /** @param {any} state */
  #take(state) {
    this.document = state.document;
    this.revision = state.revision;
    this.undoTitle = state.undo;
    this.redoTitle = state.redo;
    this.variants = state.variants;
    this.dispatchEvent(new Event("change"));
  }

  /** @param {unknown} error */
  async #refused(error) {
    const sentence = error instanceof Error ? error.message : String(error);
    if (error instanceof Refusal && error.status !== 0) this.#take(await get("/api/plan"));
    this.dispatchEvent(new CustomEvent("refused", { detail: sentence }));
  }
}
