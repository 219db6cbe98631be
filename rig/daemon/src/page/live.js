// The live view of the rig's jobs: the camera's picture with its overlay, motion, figures, the fit.

import { $, element, listen } from "./api.js";
import { lineChart, lineClass, room, svg } from "./chart.js";

let rig = { name: "", motion: null, analysis: null };
let listening = null;
let frozen = false;
let due = false;
const jobs = new Map();
const pictures = new Map();

// The rig that the page shows, and what it does.
export function showRig(state) {
  const isOther = state.name !== rig.name;
  rig = state;
  if (isOther) {
    jobs.clear();
    pictures.clear();
    clear();
    listenAgain();
  }
  draw();
}

// While nobody looks at the page, or the picture is frozen, nothing is drawn for it.
function listenAgain() {
  listening?.abort();
  listening = null;
  if (!rig.name || document.hidden || frozen) return;
  listening = new AbortController();
  listen(`/rigs/${encodeURIComponent(rig.name)}/live`, take, () => {}, listening.signal);
}
document.addEventListener("visibilitychange", listenAgain);
$("freeze").onclick = () => {
  frozen = !frozen;
  $("freeze").setAttribute("aria-pressed", frozen);
  $("freeze").textContent = frozen ? "Go on" : "Freeze";
  listenAgain();
  draw();
};
$("drawn").onchange = () => { $("found").style.visibility = $("drawn").checked ? "visible" : "hidden"; };

const goesOn = job => job === rig.motion || job === rig.analysis;

function take(snapshot) {
  if (frozen) return;
  // a campaign's next run has nothing of the one before
  if (jobs.get(snapshot.job)?.run !== snapshot.run) pictures.delete(snapshot.job);
  jobs.set(snapshot.job, snapshot);
  if (snapshot.picture) pictures.set(snapshot.job, snapshot.picture);
  // the last view of a job stays until another job has one of the same kind
  for (const job of jobs.keys()) {
    if (!goesOn(job) && job !== snapshot.job && job !== newest(isFilmed) && job !== newest(isFitted)) [jobs, pictures].forEach(map => map.delete(job));
  }
  draw();
}

const isFilmed = ({ job, traces }) => pictures.has(job) || traces.length > 0;
const isFitted = ({ fit }) => fit && fit.curve.length + fit.rough.length > 0;
const newest = holds => [...jobs.values()].filter(holds).reduce((last, { job }) => Math.max(last, job), 0);

// All of it once a frame, however much has come.
function draw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    const filmed = [rig.motion, rig.analysis, newest(isFilmed)].find(job => jobs.has(job) && isFilmed(jobs.get(job)));
    showStage(filmed);
    if (filmed !== undefined) {
      showPicture(filmed);
      showTraces(jobs.get(filmed));
      showFigures(jobs.get(filmed));
    }
    showFits();
  });
}

function clear() {
  $("film").hidden = true;
  $("film-tools").hidden = !frozen;
  $("seen").textContent = "";
  for (const id of ["figures", "traces", "fits"]) $(id).replaceChildren();
}

const seconds = value => `${value.toFixed(1)} s`;

function showStage(filmed) {
  const words = [...jobs.values()].filter(snapshot => goesOn(snapshot.job)).map(({ job, stage, steps }) =>
    `Job ${job}: ${stage}${steps ? `, ${steps[0]} of ${steps[1]}` : ""}`);
  const last = filmed === undefined ? "" : ` What job ${filmed} showed last is below.`;
  $("stage").textContent = frozen ? "Frozen." : words.length ? words.join("; ") : `No job goes on.${last}`;
}

let shown = null;

function showPicture(job) {
  const picture = pictures.get(job);
  $("film").hidden = !picture;
  $("film-tools").hidden = !picture && !frozen;
  if (!picture || picture === shown) return;
  shown = picture;
  const bytes = Uint8Array.from(atob(picture.jpeg), letter => letter.charCodeAt(0));
  const image = element("img", { id: "picture", alt: "", src: URL.createObjectURL(new Blob([bytes], { type: "image/jpeg" })) });
  // the overlay changes together with the picture, not before
  image.decode().then(() => {
    if (picture !== shown) return;
    $("film").style.aspectRatio = picture.size_px.join(" / ");
    $("picture").replaceWith(image);
    showFound(picture, ...picture.size_px);
  }).catch(() => {}).finally(() => URL.revokeObjectURL(image.src));
}

function showFound({ found, time_s, size_px }, width, height) {
  const parts = [];
  const pen = Math.max(width, height) / 320;
  const path = (lines, closed) => lines.filter(line => line.length > 1).map(line => `M${line.map(point => point.join(" ")).join("L")}${closed ? "Z" : ""}`).join("");
  const millimetres = found?.keypoints.map(({ name, metres }) => `${name} ${metres.map(value => (value * 1e3).toFixed(1)).join(", ")} mm`) ?? [];
  if (found) {
    parts.push(svg("path", { class: found.status === "rejected" ? "outline rejected" : "outline", d: path(found.outline, true), "stroke-width": pen }),
      svg("path", { class: "centreline", d: path([found.centreline], false), "stroke-width": pen }));
    found.keypoints.forEach(({ name, px }, i) => {
      const end = i === 0 || i + 1 === found.keypoints.length;
      parts.push(svg("circle", { class: end ? "spot end" : "spot", cx: px[0], cy: px[1], r: 2.6 * pen, "stroke-width": pen / 2 }));
      if (found.keypoints.length < 12)
        parts.push(svg("text", { x: px[0] + 5 * pen, y: px[1] + 4 * pen, "font-size": 11 * pen, "stroke-width": 2.5 * pen }, name));
    });
  }
  const doubt = found && found.status !== "ok" ? `, ${found.status}: ${found.reason}` : "";
  const text = `Picture at ${seconds(time_s)}, ${size_px[0]} x ${size_px[1]} px${found ? doubt : "; not processed yet"}`;
  const view = $("found");
  // a pixel's centre is a whole number
  view.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
  view.setAttribute("aria-label", `${text}. ${millimetres.length ? `Keypoints: ${millimetres.join("; ")}` : "No keypoints."}`);
  view.replaceChildren(...parts);
  $("seen").textContent = `${text}${found ? `; ${found.keypoints.length} keypoints` : ""}.`;
}

const QUANTITIES = { angle: ["Servo", "°", 180 / Math.PI, 4], default: ["Keypoints", "mm", 1e3, 1] };

function showTraces(snapshot) {
  if (!snapshot.traces.length) return $("traces").replaceChildren();
  const width = room($("traces"));
  const quantities = [...new Set(snapshot.traces.map(group => group.quantity))];
  const ends = snapshot.traces.flatMap(group => group.time_s.slice(-1));
  const to = Math.max(...ends), from = Math.min(...snapshot.traces.flatMap(group => group.time_s.slice(0, 1)));
  $("traces").replaceChildren(...quantities.map(quantity => {
    const [what, unit, factor, least] = QUANTITIES[quantity] ?? QUANTITIES.default;
    const lines = [], legend = [];
    for (const group of snapshot.traces.filter(group => group.quantity === quantity)) {
      for (const { name, values } of group.lines) {
        const place = lines.length;
        lines.push({ place, points: values.map((value, i) => [group.time_s[i], value === null ? null : value * factor]) });
        const last = values.findLast(value => value !== null);
        const text = last === undefined ? `${name}: not observed` : `${name} ${(last * factor).toFixed(1)} ${unit}`;
        legend.push(element("li", {}, svgKey(place), text));
      }
    }
    const title = quantity === "angle" ? what : `${what}, ${quantity}`;
    const label = `${title} over the last ${Math.round(to - from)} s: ${legend.map(item => item.textContent).join("; ")}`;
    return element("figure", {}, element("figcaption", { textContent: title }),
      lineChart({ width, label, lines, from, to, unit, xUnit: "time, s", least }), element("ul", { className: "legend" }, ...legend));
  }));
}

const svgKey = place => svg("svg", { class: "key", viewBox: "0 0 20 8", "aria-hidden": "true" }, svg("path", { class: lineClass(place), d: "M0 4H20" }));

function showFigures({ figures: f }) {
  if (!f) return $("figures").replaceChildren();
  const ms = (value, digits) => `${(value * 1e3).toFixed(digits).replace(/^-(0\.?0*)$/, "$1")} ms`;
  const rows = [
    ["Images", `${f.received} received, ${f.lost} lost, ${f.damaged} damaged`, f.lost || f.damaged],
    ["Waiting for the disk", `${f.waiting_mib} of ${f.queue_mib} MiB`, f.waiting_mib > f.queue_mib / 2],
  ];
  if (f.fps !== undefined) rows.splice(1, 0, ["Rate", `${f.fps.toFixed(1)} of ${f.promised_fps.toFixed(1)} a second`, false]);
  if (f.repeated || f.stale) rows.push(["Repeated, stale", `${f.repeated}, ${f.stale}`, true]);
  if (f.behind_s !== undefined) rows.push(["Delay of the keypoints", seconds(f.behind_s), false]);
  if (f.clock) rows.push(["Servo board's clock", `gained ${ms(f.clock.gained_s, 2)}, known to ±${ms(1.96 * f.clock.sigma_s, 2)} (95 %), ${f.clock.drift_ppm.toFixed(0)} ppm`, false]);
  if (f.start_late_s !== undefined) rows.push(["Motion began late by", ms(f.start_late_s, 2), Math.abs(f.start_late_s) > 0.02]);
  $("figures").replaceChildren(...rows.flatMap(([name, value, bad]) =>
    [element("dt", { textContent: name }), element("dd", { textContent: value, className: bad ? "failed" : "" })]));
}

function showFits() {
  const fits = [...jobs.values()].filter(snapshot => isFitted(snapshot) && (goesOn(snapshot.job) || snapshot.job === newest(isFitted)));
  if (!fits.length) return $("fits").replaceChildren(element("p", { textContent: "No fit goes on." }));
  $("fits").replaceChildren(...fits.map(({ job, fit }) => {
    const lines = [["over all images", fit.curve], ["over some images", fit.rough]].map(([name, curve], place) =>
      ({ name, place, points: curve.map(([at, rms_m]) => [at, rms_m * 1e3]) })).filter(line => line.points.length);
    const all = lines.flatMap(line => line.points).sort(([a], [b]) => a - b), values = all.map(([, value]) => value);
    // errors over some of the images cannot be compared with those over all
    const shownPoints = lines[0].points;
    const [first, last] = [shownPoints[0][1], shownPoints.at(-1)[1]];
    const text = `Job ${job}, ${fit.name}: ${fit.phase}, ${fit.evaluations} of at most ${fit.max_evaluations} evaluations, ${last.toPrecision(3)} mm rms`;
    const label = `${text}; it began with ${first.toPrecision(3)} mm`;
    const chart = lineChart({ width: room($("fits")), label, lines, from: all[0][0], to: fit.evaluations, unit: "mm rms", xUnit: "evaluations",
      log: Math.max(...values) > 3 * Math.min(...values) });
    const legend = element("ul", { className: "legend" }, ...lines.map(({ name, place }) => element("li", {}, svgKey(place), name)));
    const rows = fit.parameters.map(({ name, value }) => element("tr", {}, element("th", { scope: "row", textContent: name }), element("td", { textContent: Math.abs(value) > 0 && Math.abs(value) < 1e-3 ? value.toExponential(3) : value.toPrecision(4) })));
    return element("figure", {}, element("figcaption", { textContent: text }), chart, legend,
      element("table", { className: "values" }, element("caption", { className: "unseen", textContent: "Current parameter values" }), element("tbody", {}, ...rows)));
  }));
}
