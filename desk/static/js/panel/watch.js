// A survey that is being driven: the events of firnline watch, where the rover is, and the map after each update.
import { element } from "../dom.js";
import { Replay } from "./replay.js";
import { Working } from "./working.js";

const MOST_LINES = 200;

export class Watch {
  /** @param {any} map @param {import("../map/layers.js").Layers} layers @param {string} name */
  constructor(map, layers, name) {
    this.replay = new Replay(map, layers, "watched", "Drive that is watched");
    this.lines = element("ol", { class: "small", id: "watch-lines", "aria-live": "polite" });
    const working = new Working("watch", "Follow the drive", (event) => this.#follow(event));
    this.part = element("div", { class: "stack" },
      element("h2", { text: "Drive" }),
      element("p", { class: "note", text: `Follows firnline watch, whose log has to be written beside the plan: --log ${name}.watch.jsonl.` }),
      working.part, this.replay.part, this.lines);
  }

  /** @param {any} event */
  #follow(event) {
    if (event.kind === "started") {
      this.replay.clear();
      this.lines.replaceChildren();
    }
    this.replay.take(event);
    if (event.kind !== "watch") return;
    this.lines.prepend(element("li", { text: event.text, class: event.do === "stop" ? "stop" : "" }));
    while (this.lines.children.length > MOST_LINES) this.lines.lastChild?.remove();
  }
}
