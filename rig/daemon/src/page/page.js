// The daemon's page: shows the state from the API, and sends its commands. Nothing is loaded from anywhere else.

import { $, API, Refused, ask, askForToken, element, fill, listen } from "./api.js";
import { showRig } from "./live.js";
import { showCoefficients, showTrend } from "./trends.js";

const PAGE_OF_RUNS = 50;
const SHOWN_ALERTS = 5;
const CAMPAIGN_RUNS = 4;
const snapshots = new Map();
let chosen = "";
let shownRuns = [];

const inRig = path => `/rigs/${encodeURIComponent(chosen)}${path}`;

const time = text => text ? new Date(text).toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" }) : "";
const showMessage = text => { $("said").textContent = text; };

async function command(path, body, done, headers) {
  for (;;) {
    try {
      const answer = await ask(inRig(path), body, headers);
      return showMessage(done(answer));
    } catch (error) {
      if (error.status === 401 && await askForToken()) continue;
      return showMessage(error instanceof Refused ? error.message : `The daemon does not answer: ${error.message}. Use the emergency switch if anything moves.`);
    }
  }
}

$("stop").onclick = () => command("/stop", { by: "the page", why: "the stop button" },
  stopped => stopped.written ? "Stopped and held." : "Stopped; only the daemon holds the rig: the hold could not be written to the disk.");
$("held").onsubmit = event => {
  event.preventDefault();
  command("/release", { by: $("who").value }, ({ released }) => `${released[0].toUpperCase()}${released.slice(1)}.`);
};
// The same key marks a repeated request as one job.
const key = () => [...crypto.getRandomValues(new Uint8Array(16))].map(byte => byte.toString(16).padStart(2, "0")).join("");
const add = work => command("/jobs", { work, why: "from the page" }, job => `Job ${job.job} waits for its turn.`, { "Idempotency-Key": key() });
$("cancel-all").onclick = () => command("/jobs/cancel", { why: "from the page" }, ({ cancelled }) => `${cancelled} jobs are cancelled.`);
$("run").onclick = () => add({ kind: "run" });
$("campaign").onclick = () => add({ kind: "campaign", max_runs: CAMPAIGN_RUNS });

const DOING = {
  "at-rest": () => "At rest",
  computing: () => "Computes; nothing has power",
  announced: ({ moves_in_s }) => `Moves in ${Math.ceil(moves_in_s ?? 0)} s`,
  armed: () => "Armed: may move at any instant",
  moving: () => "Moves",
  unknown: ({ since }) => `Not known${since ? ` since ${time(since)}` : ""}: may move`,
};
// A snapshot older than this says nothing about the present.
const FRESHNESS_LIMIT_MS = 2000;
const receivedAt = new Map();

function showNow({ rig, jobs }) {
  const silent = Date.now() - (receivedAt.get(rig.name) ?? 0);
  const fresh = silent < FRESHNESS_LIMIT_MS;
  const job = id => jobs.find(job => job.id === id);
  const kind = id => `job ${id}${job(id) ? ` (${job(id).work.kind})` : ""}`;
  const text = fresh ? (rig.hold && rig.doing === "at-rest" ? "Held" : DOING[rig.doing](rig.servos)) : `No news for ${Math.round(silent / 1000)} s: the rig may move`;
  document.body.classList.toggle("stale", !fresh);
  document.body.dataset.doing = fresh ? rig.doing : "unknown";
  // a screen reader reads a change, so set it only when it changes
  if ($("now").textContent !== text) $("now").textContent = text;
  document.title = `${text} · ${rig.name}`;
  $("experiment").textContent = rig.experiment;
  const more = [rig.motion, rig.analysis].filter(id => id !== null).map(kind);
  if (rig.waits && !rig.hold) more.push(`the next motion waits: ${rig.waits}`);
  if (rig.trouble) more.push(`error of the daemon: ${rig.trouble}`);
  $("more").textContent = fresh ? more.join("; ") : `It was last heard of at ${new Date(receivedAt.get(rig.name)).toLocaleTimeString()}. What is shown below is from then.`;
  $("held").hidden = !rig.hold;
  if (rig.hold) $("held-why").textContent = `By ${rig.hold.by}, ${time(rig.hold.since)}: ${rig.hold.why}`;
  $("next").textContent = rig.next_run ? `Next run by the schedule: ${time(rig.next_run)}` : "No schedule.";
}
setInterval(() => { if (snapshots.has(chosen)) showNow(snapshots.get(chosen)); }, 250);

function resultOf(job) {
  const { error, verdict, run, out, warnings } = job;
  // the run's folder stands before a colon
  if (error) return error.split("\n")[0].replace(/^run \S+: /, "");
  const result = verdict ?? (run ?? out ?? job.cancel ?? job.why ?? "").split("/").pop();
  return [result, ...warnings ?? []].join("; ");
}

const row = (...cells) => element("tr", {}, ...cells.map(cell => cell instanceof Node ? element("td", {}, cell) : element("td", cell)));
const empty = textContent => row({ colSpan: 6, textContent });

function jobRow(job) {
  const over = !["queued", "running"].includes(job.state);
  const label = over ? `Retry job ${job.id}` : `Cancel job ${job.id}`;
  // a motion that was done is not repeated by a slip of the hand
  const moved = job.state === "done" && ["run", "campaign"].includes(job.work.kind);
  const button = element("button", { type: "button", textContent: over ? "Retry" : "Cancel", ariaLabel: label, hidden: moved });
  button.onclick = () => over
    ? command(`/jobs/${job.id}/retry`, { why: "from the page" }, again => `Job ${again.job} waits for its turn.`)
    : command(`/jobs/${job.id}/cancel`, { why: "from the page" }, () => `Job ${job.id} is told to end.`);
  return row({ textContent: job.id }, { textContent: job.work.kind }, { textContent: job.state, className: job.state },
    { textContent: time(job.added) }, button, { textContent: resultOf(job), className: "came", title: job.why ?? "" });
}

function showJobs({ jobs }) {
  // keep the keyboard focus on the button of a row that changes
  const focused = document.activeElement?.ariaLabel;
  fill($("jobs"), jobs.length ? jobs : ["No jobs yet."], job => job.id ? jobRow(job) : empty(job));
  $("cancel-all").hidden = !jobs.some(job => job.state === "queued");
  if (focused) [...$("jobs").querySelectorAll("button")].find(button => button.ariaLabel === focused)?.focus();
}

function runRow(run) {
  const report = run.report
    ? element("a", { href: `${API}${inRig(`/runs/${run.id}/report.html`)}`, target: "_blank", rel: "noopener", textContent: "Report", ariaLabel: `Report of run ${run.id}` })
    : {};
  return row({ textContent: time(run.began) }, { textContent: run.status, className: run.status, title: run.reason ?? "" }, report,
    { textContent: run.headline?.line ?? "", className: `came ${run.headline?.tone ?? ""}` }, { textContent: run.verdict ?? "" }, { textContent: run.id });
}

async function showRuns(more) {
  const earlier = more ? shownRuns : [];
  const before = earlier.length ? `&before=${earlier.at(-1).id}` : "";
  const runs = await ask(inRig(`/runs?most=${PAGE_OF_RUNS}${before}`));
  shownRuns = [...earlier, ...runs.reverse()];
  fill($("runs"), shownRuns.length ? shownRuns : ["No runs yet."], run => run.id ? runRow(run) : empty(run));
  $("older").hidden = runs.length < PAGE_OF_RUNS;
}
$("older").onclick = () => showRuns(true).catch(error => showMessage(error.message));

async function showAlerts() {
  const alerts = await ask(inRig(`/alerts?most=${SHOWN_ALERTS}`));
  const line = alert => alert.text ? element("li", {}, element("time", { textContent: time(alert.raised) }), ` ${alert.text}`) : element("li", { textContent: alert });
  fill($("alerts"), alerts.length ? alerts : ["No alerts yet."], line);
}

$("coefficients").onchange = $("determined").onchange = () => showTrend(inRig).catch(error => showMessage(error.message));

const refresh = () => Promise.all([showRuns(false), showAlerts(), showCoefficients(inRig)]).catch(error => showMessage(error.message));

function show(name) {
  const snapshot = snapshots.get(name);
  if (!snapshot || name !== chosen) return;
  showNow(snapshot);
  showJobs(snapshot);
  showRig(snapshot.rig);
}

function choose(name) {
  chosen = name;
  // what is done by a row goes to its rig
  for (const id of ["jobs", "runs"]) $(id).replaceChildren();
  show(name);
  refresh();
}
$("rigs").onchange = () => choose($("rigs").value);

function take(snapshot) {
  const name = snapshot.rig.name;
  const known = snapshots.get(name);
  snapshots.set(name, snapshot);
  receivedAt.set(name, Date.now());
  if (!known) {
    $("rigs").append(element("option", { value: name, textContent: name }));
    $("choose").hidden = snapshots.size < 2;
    if (!chosen) return choose(name);
  }
  show(name);
  const over = ({ jobs }) => jobs.filter(job => job.ended).map(job => job.id).join();
  if (known && name === chosen && over(known) !== over(snapshot)) refresh();
}

// A browser has few connections for all of its windows: a hidden page closes its own, for the visible one with the stop button.
let listening = null;
function listenAgain() {
  listening?.abort();
  listening = document.hidden ? null : new AbortController();
  if (listening) listen("/events", take, text => { $("link").textContent = text; }, listening.signal);
}
document.addEventListener("visibilitychange", listenAgain);
listenAgain();
