// Requests to the server of the desk. The page itself computes nothing.

export class Refusal extends Error {
  /** @param {string} sentence @param {number} status */
  constructor(sentence, status) {
    super(sentence);
    this.status = status;
  }
}

/** @param {Response} answer */
async function contentOf(answer) {
  if (answer.ok) return answer.json();
  const isJson = (answer.headers.get("content-type") ?? "").startsWith("application/json");
  const sentence = isJson ? (await answer.json()).error : await answer.text();
  throw new Refusal(sentence, answer.status);
}

/** @param {unknown} error @returns {never} */
function unreachable(error) {
  if (error instanceof DOMException && error.name === "AbortError") throw error;
  throw new Refusal("The server of the desk does not answer; start firnline desk again. The plan is stored.", 0);
}

/**
 * Ask for something.
 * @param {string} path
 * @param {AbortSignal} [signal]
 * @returns {Promise<any>}
 */
export async function get(path, signal) {
  return contentOf(await fetch(path, { signal }).catch(unreachable));
}

/**
 * Send an object, or a file as it is.
 * @param {string} path
 * @param {unknown} content
 * @returns {Promise<any>}
 */
export async function post(path, content) {
  const isFile = content instanceof Blob;
  const headers = { "content-type": isFile ? "application/octet-stream" : "application/json" };
  const body = isFile ? content : JSON.stringify(content);
  return contentOf(await fetch(path, { method: "POST", headers, body }).catch(unreachable));
}
