// Long computations on the server, followed by server-sent events.
import { post } from "./api.js";

/** @typedef {{job: string, cancel: () => void}} Running */

/**
 * Start a job and follow it.
 * @param {"guarantee"|"curve"|"mission"|"map"|"next"|"watch"|"replay"} kind
 * @param {(event: any) => void} follow Called with each event; the last one is done, refused or cancelled.
 * @param {Record<string, string>} [about] What the job is about beside the plan.
 * @returns {Promise<Running>}
 */
export async function runJob(kind, follow, about = {}) {
  const { job } = await post("/api/jobs", { kind, ...about });
  const source = new EventSource(`/api/jobs/${job}/events`);
  source.onmessage = (message) => {
    const event = JSON.parse(message.data);
    if (["done", "refused", "cancelled"].includes(event.kind)) source.close();
    follow(event);
  };
  source.onerror = () => {
    source.close();
    follow({ kind: "refused", error: "The server of the desk does not answer; start firnline desk again." });
  };
  return { job, cancel: () => void fetch(`/api/jobs/${job}`, { method: "DELETE" }) };
}
