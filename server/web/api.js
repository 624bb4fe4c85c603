// The service's API as the page uses it.

/// A refusal: what the service said of it (RFC 9457), with the position of what is wrong.
export class Problem extends Error {
  constructor(document, status) {
    super(document.detail || document.title || `the server answered ${status}`);
    this.document = document;
    this.status = status;
  }
}

export function authorization() {
  const token = sessionStorage.getItem("token");
  return token ? { Authorization: `Bearer ${token}` } : {};
}

async function checked(response) {
  if (response.ok) return response;
  if (response.status === 401) document.getElementById("access").hidden = false;
  let body = {};
  try {
    body = await response.json();
  } catch {
    // An answer without a document: the status has to do.
  }
  const problem = new Problem(body, response.status);
  problem.retryAfter = Number(response.headers.get("Retry-After")) || 0;
  throw problem;
}

export async function get(path, signal) {
  const response = await fetch(path, { headers: authorization(), signal });
  return (await checked(response)).json();
}

export async function post(path, document) {
  const headers = { ...authorization(), "Content-Type": "application/json" };
  const response = await fetch(path, { method: "POST", headers, body: document === undefined ? null : JSON.stringify(document) });
  return (await checked(response)).json();
}

/// Saves a text or an answer of the service as a file. A plain link would not carry the token.
export async function save(name, source) {
  let blob = source;
  try {
    if (!(source instanceof Blob)) blob = await (await checked(await fetch(source, { headers: authorization() }))).blob();
  } catch (error) {
    document.getElementById("message").textContent = `${name} could not be fetched: ${error.message}`;
    return;
  }
  const url = URL.createObjectURL(blob);
  const anchor = document.createElement("a");
  anchor.href = url;
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

let causes = null;
/// Every cause that can be named, asked for once.
export function allCauses() {
  causes ??= get("/v1/causes").then((list) => list.items).catch((error) => {
    causes = null;
    throw error;
  });
  return causes;
}

/// Waits; rejects as soon as the view is left.
export function pause(milliseconds, signal) {
  return new Promise((resolve, reject) => {
    const left = () => reject(signal.reason);
    if (signal?.aborted) return left();
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", left);
      resolve();
    }, milliseconds);
    signal?.addEventListener("abort", () => {
      clearTimeout(timer);
      left();
    }, { once: true });
  });
}
