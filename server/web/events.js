// What changes on the server, by one long poll for the whole page. A server that restarts is waited for.
import { Problem, get, pause } from "./api.js";

const WAIT_S = 25;
const AGAIN_MS = 1500; // after an error, or where too many wait already

const SILENT = "The server does not answer. The page goes on by itself when it is back.";

/// Says that the server is silent, or takes that back.
function showSilence(silent) {
  const message = document.getElementById("message");
  if (silent) message.textContent = SILENT;
  else if (message.textContent === SILENT) message.textContent = "";
}

/// Calls onChange(subjects) with the set of ids that changed, until the view is left; null instead of a set where changes
/// may have been missed, so that everything has to be asked for again.
export async function follow(onChange, signal) {
  let cursor = null;
  let wait = WAIT_S;
  while (!signal.aborted) {
    try {
      if (cursor === null) {
        cursor = (await get("/v1/events", signal)).next;
        showSilence(false);
        await onChange(null);
      }
      const answer = await get(`/v1/events?after=${cursor}&wait_s=${wait}&limit=1000`, signal);
      cursor = answer.next;
      if (answer.items.length > 0) await onChange(new Set(answer.items.map((event) => event.subject)));
      if (wait === 0) await pause(AGAIN_MS, signal);
      wait = WAIT_S;
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Problem && error.status < 500) throw error;
      if (error instanceof Problem && error.status === 503) wait = 0;
      else cursor = null;
      if (!(error instanceof Problem)) showSilence(true);
      await pause(AGAIN_MS, signal).catch(() => {});
    }
  }
}
