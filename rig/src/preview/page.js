"use strict";
// Asks for a picture and the figures again and again; places stay here until they are written.

const PERIOD_MS = 200;
const KEYS = ["base_px", "origin_px"];
const TABLES = { base_px: "vision", origin_px: "calibration" };
const NAMES = { base_px: "base", origin_px: "origin" };

const $ = (id) => document.getElementById(id);
const stage = $("stage"), picture = $("picture"), marks = $("marks");

let size = null;              // of the picture [px]
let known = null;             // what the config says
const places = { base_px: null, origin_px: null };
const touched = new Set();    // places set here and not written yet

const tenth = (value) => Math.round(value * 10) / 10;
const decimal = (value) => value.toFixed(1);
const chosen = () => document.querySelector("input[name=place]:checked").value;

function say(id, text, note = "", tone = "") {
  $(id).textContent = text;
  const below = $(id + "-note");
  if (below.textContent !== note) below.textContent = note;
  below.className = tone;
}

// --- places -------------------------------------------------------------------------------------

function place(key, px) {
  if (key === "origin_px" && known && known.origin_is_fixed) return;
  if (size) px = px.map((value, i) => Math.min(Math.max(value, -0.5), size[i] - 0.6));
  places[key] = px.map(tenth);
  touched.add(key);
  $("outcome").textContent = "";
  show();
}

function show(fields = true) {
  for (const key of KEYS) {
    for (const i of [0, 1]) {
      const field = $(`${key}-${i}`);
      if (fields || document.activeElement !== field) field.value = places[key] ? decimal(places[key][i]) : "";
      field.disabled = key === "origin_px" && Boolean(known && known.origin_is_fixed);
    }
  }
  const lines = KEYS.filter((key) => places[key] && !(key === "origin_px" && known && known.origin_is_fixed))
    .map((key) => `[${TABLES[key]}]\n${key} = [${places[key].map(decimal).join(", ")}]`);
  const text = lines.join("\n\n");
  if ($("lines").value !== text) $("lines").value = text;
  $("write").disabled = touched.size === 0;
  $("reset").disabled = touched.size === 0;
  $("places-note").textContent = known && known.origin_is_fixed
    ? "The origin belongs to the calibration file: rig calibrate camera --origin-px sets it." : "";
  draw();
}

function draw() {
  marks.replaceChildren();
  if (!size) return;
  marks.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
  links();
  const reach = Math.max(size[0], size[1]) / 40;
  for (const key of KEYS) {
    if (!places[key]) continue;
    const [x, y] = places[key].map((value) => value + 0.5);
    for (const name of ["halo", NAMES[key]]) {
      for (const [dx, dy] of [[1, 0], [0, 1]]) {
        for (const side of [-1, 1]) {
          const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
          const ends = { x1: x + side * dx * reach * 0.2, y1: y + side * dy * reach * 0.2, x2: x + side * dx * reach, y2: y + side * dy * reach };
          for (const [end, value] of Object.entries(ends)) line.setAttribute(end, value);
          line.setAttribute("class", name);
          marks.append(line);
        }
      }
    }
  }
}

// The model at rest, where the config sees it; it goes along with an origin that is not written yet.
function links() {
  if (!known || !$("links").checked) return;
  const from = known.origin_px, to = places.origin_px;
  const by = from && to && !known.origin_is_fixed ? [0, 1].map((i) => to[i] - from[i]) : [0, 0];
  for (const corners of known.links_px) {
    const link = document.createElementNS("http://www.w3.org/2000/svg", "polygon");
    link.setAttribute("points", corners.map((px) => px.map((value, i) => value + by[i] + 0.5).join(",")).join(" "));
    link.setAttribute("class", "link");
    marks.append(link);
  }
}

$("links").addEventListener("change", () => draw());

stage.addEventListener("click", (event) => {
  if (!size) return;
  const box = picture.getBoundingClientRect();
  // The centre of the top left pixel is (0, 0).
  place(chosen(), [
    (event.clientX - box.left) / box.width * size[0] - 0.5,
    (event.clientY - box.top) / box.height * size[1] - 0.5,
  ]);
});

stage.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (!step || !size) return;
  event.preventDefault();
  const key = chosen(), by = event.shiftKey ? 10 : 1;
  const from = places[key] || size.map((side) => Math.round(side / 2));
  place(key, from.map((value, i) => value + by * step[i]));
});

for (const key of KEYS) {
  for (const i of [0, 1]) {
    $(`${key}-${i}`).addEventListener("change", () => {
      const values = [0, 1].map((j) => parseFloat($(`${key}-${j}`).value));
      if (values.every(Number.isFinite)) place(key, values);
    });
  }
}

$("reset").addEventListener("click", () => {
  touched.clear();
  adopt();
  show();
});

$("write").addEventListener("click", async () => {
  const body = {};
  for (const key of touched) body[key] = places[key];
  const outcome = $("outcome");
  try {
    const answer = await fetch("/config", {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
    });
    if (!answer.ok) throw new Error((await answer.json()).error);
    const { written } = await answer.json();
    touched.clear();
    outcome.className = "good";
    outcome.textContent = `Written into ${written}.`;
  } catch (error) {
    outcome.className = "bad";
    outcome.textContent = `Not written: ${error.message}`;
  }
  show();
});

function adopt() {
  for (const key of KEYS) {
    if (!touched.has(key)) places[key] = known && known[key] ? known[key].map(tenth) : null;
  }
}

// --- figures ------------------------------------------------------------------------------------

function figures(state) {
  const { rolling, measures } = state;
  const camera = rolling.camera;
  $("camera").textContent = camera
    ? `${camera.name} · ${camera.width_px} × ${camera.height_px} px · ${camera.fps} images/s asked for · ${state.config.file}`
    : "waiting for the camera";
  const trouble = [rolling.error, state.unreadable && `picture cannot be read: ${state.unreadable}`,
    state.config.error && `config: ${state.config.error}`].filter(Boolean).join(" · ");
  tell(trouble);

  const missing = rolling.lost + rolling.skipped;
  const slow = camera && rolling.fps && Math.abs(rolling.fps / camera.fps - 1) > 0.05;
  say("rate", rolling.fps ? `${rolling.fps.toFixed(2)} images/s` : "–",
    `${rolling.lost} of ${rolling.received + rolling.lost} lost by the camera${rolling.skipped ? `, ${rolling.skipped} not looked at here` : ""}`
      + (slow ? "; more than 5 % off what was asked for: shorten the exposure" : ""),
    rolling.lost || slow ? "caution" : missing ? "" : "good");
  if (!measures) return;

  const { edge_width_px: edge, best_edge_width_px: best, saturation, grey, flicker } = measures;
  $("focus-meter").value = edge ? best / edge : 0;
  say("focus", edge ? `edges ${edge.toFixed(2)} px wide` : "no edge in sight",
    edge ? `narrowest so far ${best.toFixed(2)} px; turn the lens until it does not get narrower` : "",
    edge && edge < best * 1.1 ? "good" : "");
  const percent = (share) => `${(100 * share).toFixed(share < 0.1 ? 2 : 0)} %`;
  if (saturation) {
    const light = saturation.light_share > 0.001;
    say("saturation", `${percent(saturation.light_share)} white, ${percent(saturation.dark_share)} black`,
      light ? "less light, or a shorter exposure" : "none to speak of", light ? "caution" : "good");
  }
  if (grey) {
    const little = grey.high - grey.low < 60;
    say("grey", `${grey.low} … ${grey.high}`, `middle ${grey.middle}, of 0 to 255` + (little ? "; little contrast: more light behind the mechanism" : ""),
      little ? "caution" : "");
  }
  const watched = measures.flicker_s;
  say("flicker", flicker ? `±${flicker.percent.toFixed(2)} % at ${flicker.hz.toFixed(1)} Hz` : watched < 1 ? "looking …" : "none found",
    flicker
      ? (flicker.lamp_hz ? `looks like a lamp of ${flicker.lamp_hz} Hz at this rate; ` : "") + "lamps on direct current do not flicker; something that moves does as well"
      : watched < 1 ? "" : `in ${watched.toFixed(1)} s`,
    flicker && flicker.percent > 1 ? "caution" : flicker ? "" : watched < 1 ? "" : "good");
  say("parts", measures.parts_px === null ? "nothing" : `${measures.parts_px} px`,
    measures.no_parts || (measures.masked_px !== null ? `static mask: ${measures.masked_px} px` : ""),
    measures.no_parts ? "caution" : "");
}

function tell(trouble) {
  const box = $("trouble");
  box.hidden = !trouble;
  if (box.textContent !== trouble) box.textContent = trouble;
}

// --- again and again ----------------------------------------------------------------------------

let showing = null;

async function look() {
  try {
    const answer = await fetch("/state");
    if (!answer.ok) throw new Error((await answer.json()).error);
    const state = await answer.json();
    const resized = String(size) !== String(state.size_px);
    size = state.size_px && state.size_px[0] > 0 ? state.size_px : null;
    const news = JSON.stringify(known) !== JSON.stringify(state.config);
    known = state.config;
    if (news) adopt();
    if (news || resized) show(false);
    figures(state);
    const image = await fetch($("marked").checked ? "/marked.jpg" : "/plain.jpg");
    if (image.ok) {
      const url = URL.createObjectURL(await image.blob());
      picture.src = url;
      await picture.decode().catch(() => {});
      if (showing) URL.revokeObjectURL(showing);
      showing = url;
    }
  } catch (error) {
    tell(`rig preview does not answer: ${error.message}`);
  }
  setTimeout(look, PERIOD_MS);
}

show();
look();
