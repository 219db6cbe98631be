// How the page asks the daemon. Nothing is loaded from anywhere else.

export const API = "/api/v1";
export const $ = id => document.getElementById(id);

// The token stands behind the `#` of the address that the daemon prints, and is stored for this tab only.
if (location.hash.startsWith("#token=")) {
  sessionStorage.setItem("token", location.hash.slice("#token=".length));
  history.replaceState(null, "", location.pathname);
}
const token = () => sessionStorage.getItem("token") ?? "";
const authorized = () => token() ? { Authorization: `Bearer ${token()}` } : {};

export class Refused extends Error {
  constructor(status, text) { super(text); this.status = status; }
}

export async function ask(path, body, more = {}) {
  const headers = { ...authorized(), ...more };
  const request = { headers };
  if (body !== undefined) {
    request.method = "POST";
    request.body = JSON.stringify(body);
    headers["Content-Type"] = "application/json";
  }
  const answer = await fetch(API + path, request);
  const text = await answer.text();
  if (!answer.ok) {
    let why = text;
    try { why = JSON.parse(text).error; } catch { /* not ours */ }
    throw new Refused(answer.status, why);
  }
  return JSON.parse(text);
}

export function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

// Fills `table` with a row for each of `items`, made by `make`. A row whose item is unchanged stays, so that a click on it is not lost.
export function fill(table, items, make) {
  const known = new Map([...table.children].map(row => [row.dataset.item, row]));
  const rows = items.map(item => {
    const text = JSON.stringify(item);
    const row = known.get(text) ?? make(item);
    row.dataset.item = text;
    return row;
  });
  const kept = new Set(rows);
  [...table.children].filter(row => !kept.has(row)).forEach(row => row.remove());
  rows.forEach((row, i) => {
    if (table.children[i] !== row) table.insertBefore(row, table.children[i] ?? null);
  });
}

let asking = null;

// Both streams and a command may need the token at the same time: it is asked for once.
export function askForToken() {
  asking ??= new Promise(resolve => {
    const dialog = $("ask-token");
    dialog.onclose = () => {
      asking = null;
      if (dialog.returnValue === "ok") sessionStorage.setItem("token", $("token").value.trim());
      resolve(dialog.returnValue === "ok");
    };
    dialog.returnValue = "";
    dialog.showModal();
  });
  return asking;
}

const pause = milliseconds => new Promise(resolve => setTimeout(resolve, milliseconds));

// Server-sent events by hand: EventSource cannot send a token. Runs until `signal` is aborted.
export async function listen(path, take, tell, signal) {
  while (!signal?.aborted) {
    try {
      const answer = await fetch(API + path, { headers: authorized(), signal });
      if (answer.status === 401) {
        tell("the token is wanted");
        if (await askForToken()) continue;
      }
      if (!answer.ok) throw new Error(`status ${answer.status}`);
      tell("connected");
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        text += value;
        const events = text.split("\n\n");
        text = events.pop();
        for (const event of events) {
          const data = event.split("\n").filter(line => line.startsWith("data: ")).map(line => line.slice(6)).join("\n");
          if (data) take(JSON.parse(data));
        }
      }
    } catch { /* reported below */ }
    if (signal?.aborted) return;
    tell("the daemon does not answer; trying again");
    await pause(1000);
  }
}
