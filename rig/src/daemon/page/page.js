"use strict";
// The daemon's page: what the API tells, and its few commands. Nothing is loaded from anywhere else.

const API = "/api/v1";
const PAGE_OF_RUNS = 50;
const $ = id => document.getElementById(id);
const snapshots = new Map();
let chosen = "";
let oldest = null;

// The token comes behind the `#` of the address that the daemon has told, and is kept for this tab only.
if (location.hash.startsWith("#token=")) {
  sessionStorage.setItem("token", location.hash.slice("#token=".length));
  history.replaceState(null, "", location.pathname);
}
const token = () => sessionStorage.getItem("token") ?? "";

class Refused extends Error {
  constructor(status, text) { super(text); this.status = status; }
}

async function ask(path, body) {
  const headers = token() ? { Authorization: `Bearer ${token()}` } : {};
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

const inRig = path => `/rigs/${encodeURIComponent(chosen)}${path}`;

function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

const time = text => text ? new Date(text).toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" }) : "";
const said = text => { $("said").textContent = text; };

function askForToken() {
  return new Promise(resolve => {
    const dialog = $("ask-token");
    dialog.onclose = () => {
      if (dialog.returnValue === "ok") sessionStorage.setItem("token", $("token").value.trim());
      resolve(dialog.returnValue === "ok");
    };
    dialog.returnValue = "";
    dialog.showModal();
  });
}

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
$("run").onclick = () => command("/jobs", { work: { kind: "run" }, why: "from the page" }, job => `Job ${job.job} waits for its turn.`);

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

function showJobs({ jobs }) {
  const rows = jobs.map(job => {
    const over = !["queued", "running"].includes(job.state);
    const label = over ? `Retry job ${job.id}` : `Cancel job ${job.id}`;
    const button = element("button", { type: "button", textContent: over ? "Retry" : "Cancel", ariaLabel: label });
    button.onclick = () => over
      ? command(`/jobs/${job.id}/retry`, { why: "from the page" }, again => `Job ${again.job} waits for its turn.`)
      : command(`/jobs/${job.id}/cancel`, { why: "from the page" }, () => `Job ${job.id} is told to end.`);
    return element("tr", {}, element("td", { textContent: job.id }), element("td", { textContent: job.work.kind }),
      element("td", { textContent: job.state, className: job.state }), element("td", { textContent: time(job.added) }),
      element("td", {}, button), element("td", { textContent: cameOf(job), className: "came", title: job.why ?? "" }));
  });
  if (!rows.length) rows.push(element("tr", {}, element("td", { colSpan: 6, textContent: "No jobs yet." })));
  // Whoever stands on a button of the table stays there.
  const focused = document.activeElement?.ariaLabel;
  $("jobs").replaceChildren(...rows);
  if (focused) [...$("jobs").querySelectorAll("button")].find(button => button.ariaLabel === focused)?.focus();
}

const millimetres = metres => metres === undefined ? "" : `${(metres * 1e3).toPrecision(3)} mm`;

function runRow(run) {
  const report = run.report
    ? element("a", { href: `${API}${inRig(`/runs/${run.id}/report.html`)}`, target: "_blank", rel: "noopener", textContent: "Report", ariaLabel: `Report of run ${run.id}` })
    : "";
  return element("tr", {}, element("td", { textContent: time(run.began) }),
    element("td", { textContent: run.status, className: run.status, title: run.reason ?? "" }), element("td", {}, report),
    element("td", { textContent: millimetres(run.fit_error_m) }), element("td", { textContent: run.verdict ?? "" }), element("td", { textContent: run.id }));
}

async function showRuns(more) {
  const before = more && oldest ? `&before=${oldest}` : "";
  const runs = await ask(inRig(`/runs?most=${PAGE_OF_RUNS}${before}`));
  if (!more) $("runs").replaceChildren();
  if (runs.length) oldest = runs[0].id;
  $("runs").append(...runs.reverse().map(runRow));
  if (!$("runs").children.length) $("runs").append(element("tr", {}, element("td", { colSpan: 6, textContent: "No runs yet." })));
  $("older").hidden = runs.length < PAGE_OF_RUNS;
}
$("older").onclick = () => showRuns(true).catch(error => said(error.message));

async function showCoefficients() {
  const names = await ask(inRig("/coefficients"));
  const kept = $("coefficients").value;
  $("coefficients").replaceChildren(...names.map(name => element("option", { value: name, textContent: name })));
  if (names.includes(kept)) $("coefficients").value = kept;
  await showTrend();
}

async function showTrend() {
  const name = $("coefficients").value;
  if (!name) return $("trend").replaceChildren(element("p", { textContent: "No run has been fitted yet." }));
  const trend = await ask(inRig(`/trend?name=${encodeURIComponent(name)}`));
  $("trend").replaceChildren(chart(name, trend));
}
$("coefficients").onchange = () => showTrend().catch(error => said(error.message));

// A run's id begins with when it began: 20261120T101503Z.
function began(run) {
  const [, y, mo, d, h, mi, s] = run.match(/^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)Z/) ?? [];
  return Date.UTC(y, mo - 1, d, h, mi, s);
}

function chart(name, trend) {
  const [width, height, left, bottom, top, right] = [640, 260, 70, 34, 12, 12];
  const svg = (tag, attributes, ...children) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  };
  const points = trend.map(({ run, value, std, determined }) => ({ run, at: began(run), value, half: 1.96 * (std ?? 0), determined }));
  // an undetermined one's error bar reaches its bounds and says nothing of the scale
  const scaled = points.some(point => point.determined) ? points.filter(point => point.determined) : points;
  let low = Math.min(...scaled.map(point => point.value - point.half)), high = Math.max(...scaled.map(point => point.value + point.half));
  if (low === high) [low, high] = [low - Math.abs(low || 1) * 0.05, high + Math.abs(high || 1) * 0.05];
  const [first, last] = [points[0].at, points.at(-1).at];
  const x = at => last === first ? (left + width - right) / 2 : left + (at - first) / (last - first) * (width - left - right);
  const y = value => Math.min(height - bottom, Math.max(top, height - bottom - (value - low) / (high - low) * (height - bottom - top)));
  const ticks = [0, 0.25, 0.5, 0.75, 1].map(share => low + share * (high - low));
  const parts = ticks.flatMap(tick => [
    svg("line", { class: "axis", x1: left, x2: width - right, y1: y(tick), y2: y(tick) }),
    svg("text", { x: left - 8, y: y(tick) + 4, "text-anchor": "end" }, tick.toPrecision(4)),
  ]);
  const day = at => new Date(at).toLocaleDateString();
  parts.push(svg("text", { x: left, y: height - 10 }, day(first)));
  if (last !== first) parts.push(svg("text", { x: width - right, y: height - 10, "text-anchor": "end" }, day(last)));
  for (const point of points) {
    parts.push(svg("g", { class: point.determined ? "" : "open" },
      svg("title", {}, `${point.run}: ${point.value.toPrecision(5)} +- ${point.half.toPrecision(2)} (95 %)${point.determined ? "" : ", not determined"}`),
      svg("line", { class: "band", x1: x(point.at), x2: x(point.at), y1: y(point.value - point.half), y2: y(point.value + point.half) }),
      svg("circle", { cx: x(point.at), cy: y(point.value), r: 4 })));
  }
  const newest = points.at(-1);
  const label = `${name} over ${points.length} runs, newest ${newest.value.toPrecision(4)} +- ${newest.half.toPrecision(2)}`;
  return svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, ...parts);
}

const refresh = () => Promise.all([showRuns(false), showCoefficients()]).catch(error => said(error.message));

function show(name) {
  const snapshot = snapshots.get(name);
  if (!snapshot || name !== chosen) return;
  showNow(snapshot);
  showJobs(snapshot);
}

function choose(name) {
  chosen = name;
  oldest = null;
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

// Server-sent events by hand: EventSource cannot send a token.
async function listen() {
  for (;;) {
    try {
      const headers = token() ? { Authorization: `Bearer ${token()}` } : {};
      const answer = await fetch(`${API}/events`, { headers });
      if (answer.status === 401) {
        $("link").textContent = "the token is wanted";
        if (await askForToken()) continue;
      }
      if (!answer.ok) throw new Error(`status ${answer.status}`);
      $("link").textContent = "connected";
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
    } catch { /* told below */ }
    $("link").textContent = "the daemon does not answer; trying again";
    await new Promise(resolve => setTimeout(resolve, 1000));
  }
}

listen();
