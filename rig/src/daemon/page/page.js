// The daemon's page: what the API tells, and its few commands. Nothing is loaded from anywhere else.

import { $, API, Refused, ask, askForToken, element, fill, listen } from "./api.js";
import { showRig } from "./live.js";
import { showCoefficients, showTrend } from "./trends.js";

const PAGE_OF_RUNS = 50;
const MOST_ALERTS = 5;
const MOST_CAMPAIGN_RUNS = 4;
const snapshots = new Map();
let chosen = "";
let shownRuns = [];

const inRig = path => `/rigs/${encodeURIComponent(chosen)}${path}`;

const time = text => text ? new Date(text).toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" }) : "";
const said = text => { $("said").textContent = text; };

async function command(path, body, done) {
  for (;;) {
    try {
      const answer = await ask(inRig(path), body);
      return said(done(answer));
    } catch (error) {
      if (error.status === 401 && await askForToken()) continue;
      return said(error instanceof Refused ? error.message : `The daemon does not answer: ${error.message}`);
    }
  }
}

$("stop").onclick = () => command("/stop", { why: "the stop button" },
  stopped => stopped.length ? `Job ${stopped.map(job => job.job).join(", ")} is told to stop.` : "Nothing moves.");
const add = work => command("/jobs", { work, why: "from the page" }, job => `Job ${job.job} waits for its turn.`);
$("run").onclick = () => add({ kind: "run" });
$("campaign").onclick = () => add({ kind: "campaign", max_runs: MOST_CAMPAIGN_RUNS });

function showNow({ rig, jobs }) {
  $("experiment").textContent = rig.experiment;
  const job = id => jobs.find(job => job.id === id);
  const moving = rig.motion !== null, computing = rig.analysis !== null;
  const kind = id => `job ${id}${job(id) ? ` (${job(id).work.kind})` : ""}`;
  const words = [];
  if (moving) words.push(`${kind(rig.motion)} moves the rig`);
  if (computing) words.push(`${kind(rig.analysis)} computes`);
  if (!words.length) words.push(rig.rests ? "the water rests" : "idle");
  const text = words.join("; ");
  $("now").textContent = text[0].toUpperCase() + text.slice(1);
  $("next").textContent = rig.next_run ? `Next run by the schedule: ${time(rig.next_run)}` : "No schedule.";
  document.title = `${text} · rig`;
}

function cameOf(job) {
  const { error, verdict, run, out } = job;
  // the run's folder is said before a colon
  if (error) return error.split("\n")[0].replace(/^run \S+: /, "");
  if (verdict) return verdict;
  return (run ?? out ?? job.cancel ?? job.why ?? "").split("/").pop();
}

const row = (...cells) => element("tr", {}, ...cells.map(cell => cell instanceof Node ? element("td", {}, cell) : element("td", cell)));
const empty = textContent => row({ colSpan: 6, textContent });

function jobRow(job) {
  const over = !["queued", "running"].includes(job.state);
  const label = over ? `Retry job ${job.id}` : `Cancel job ${job.id}`;
  const button = element("button", { type: "button", textContent: over ? "Retry" : "Cancel", ariaLabel: label });
  button.onclick = () => over
    ? command(`/jobs/${job.id}/retry`, { why: "from the page" }, again => `Job ${again.job} waits for its turn.`)
    : command(`/jobs/${job.id}/cancel`, { why: "from the page" }, () => `Job ${job.id} is told to end.`);
  return row({ textContent: job.id }, { textContent: job.work.kind }, { textContent: job.state, className: job.state },
    { textContent: time(job.added) }, button, { textContent: cameOf(job), className: "came", title: job.why ?? "" });
}

function showJobs({ jobs }) {
  // whoever stands on a button of a row that changes stays there
  const focused = document.activeElement?.ariaLabel;
  fill($("jobs"), jobs.length ? jobs : ["No jobs yet."], job => job.id ? jobRow(job) : empty(job));
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
  const kept = more ? shownRuns : [];
  const before = kept.length ? `&before=${kept.at(-1).id}` : "";
  const runs = await ask(inRig(`/runs?most=${PAGE_OF_RUNS}${before}`));
  shownRuns = [...kept, ...runs.reverse()];
  fill($("runs"), shownRuns.length ? shownRuns : ["No runs yet."], run => run.id ? runRow(run) : empty(run));
  $("older").hidden = runs.length < PAGE_OF_RUNS;
}
$("older").onclick = () => showRuns(true).catch(error => said(error.message));

async function showAlerts() {
  const alerts = await ask(inRig(`/alerts?most=${MOST_ALERTS}`));
  const line = alert => alert.text ? element("li", {}, element("time", { textContent: time(alert.raised) }), ` ${alert.text}`) : element("li", { textContent: alert });
  fill($("alerts"), alerts.length ? alerts : ["No alerts yet."], line);
}

$("coefficients").onchange = $("determined").onchange = () => showTrend(inRig).catch(error => said(error.message));

const refresh = () => Promise.all([showRuns(false), showAlerts(), showCoefficients(inRig)]).catch(error => said(error.message));

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
  if (!known) {
    $("rigs").append(element("option", { value: name, textContent: name }));
    $("choose").hidden = snapshots.size < 2;
    if (!chosen) return choose(name);
  }
  show(name);
  const over = ({ jobs }) => jobs.filter(job => job.ended).map(job => job.id).join();
  if (known && name === chosen && over(known) !== over(snapshot)) refresh();
}

// A browser has few connections for all of its windows: one that nobody looks at leaves them to the one with the stop button.
let listening = null;
function listenAgain() {
  listening?.abort();
  listening = document.hidden ? null : new AbortController();
  if (listening) listen("/events", take, text => { $("link").textContent = text; }, listening.signal);
}
document.addEventListener("visibilitychange", listenAgain);
listenAgain();
