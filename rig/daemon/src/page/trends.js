// How coefficients went from run to run, with marks where the model was changed.

import { $, ask, element } from "./api.js";
import { columns, room, svg, ticks } from "./chart.js";

// Changes that are listed at most.
const LISTED_CHANGES = 8;
// Runs at least this many pixels apart are drawn one by one; denser ones are drawn as columns of this width.
const MIN_POINT_SPACING_PX = 6, COLUMN_WIDTH_PX = 3;

export async function showCoefficients(inRig) {
  const names = await ask(inRig("/coefficients"));
  const chosen = $("coefficients").value;
  $("coefficients").replaceChildren(...names.map(name => element("option", { value: name, textContent: name })));
  if (names.includes(chosen)) $("coefficients").value = chosen;
  await showTrend(inRig);
}

export async function showTrend(inRig) {
  const name = $("coefficients").value;
  if (!name) return $("trend").replaceChildren(element("p", { textContent: "No run has been fitted yet." }));
  const [trend, changes] = await Promise.all([ask(inRig(`/trend?name=${encodeURIComponent(name)}`)), ask(inRig("/model-changes"))]);
  if (trend.length) $("trend").replaceChildren(...chart(name, trend, changes));
}

// A run's id begins with when it began: 20261120T101503Z.
function began(run) {
  const [, y, mo, d, h, mi, s] = run.match(/^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)Z/) ?? [];
  return Date.UTC(y, mo - 1, d, h, mi, s);
}

// Changes between the runs of the trend: half-way from the last run before each to the first one after it.
function marks(points, changes) {
  return changes.map(({ run, what }) => {
    const next = points.findIndex(point => point.run >= run);
    return { at: next > 0 ? (points[next - 1].at + points[next].at) / 2 : null, run, what: what.join(", ") };
  }).filter(mark => mark.at !== null);
}

const tell = (value, unit) => `${Number(value.toPrecision(4))}${unit === "1" || !unit ? "" : ` ${unit}`}`;

// Each run with its interval, where there is room for it; else bands from the least to the greatest, with the middle between.
function drawn(points, x, y, room) {
  const isDense = points.length * MIN_POINT_SPACING_PX > room;
  return [true, false].flatMap(determined => {
    const some = points.filter(point => point.determined === determined);
    if (!isDense) return some.map(point => svg("g", { class: determined ? "" : "open" },
      svg("title", {}, `${point.run}: ${tell(point.value, point.unit)} +- ${point.half.toPrecision(2)} (95 %)${determined ? "" : ", not determined"}`),
      svg("line", { class: "band", x1: x(point.at), x2: x(point.at), y1: y(point.value - point.half), y2: y(point.value + point.half) }),
      svg("circle", { cx: x(point.at), cy: y(point.value), r: 4 })));
    const found = columns(some.map(point => ({ x: x(point.at), y: y(point.value) })), COLUMN_WIDTH_PX);
    const path = (list, key) => list.map(column => `${column.x.toFixed(1)} ${column[key].toFixed(1)}`).join("L");
    if (!found.length) return [];
    const area = svg("path", { class: determined ? "area" : "area open", d: `M${path(found, "low")}L${path([...found].reverse(), "high")}Z` });
    return determined ? [area, svg("path", { class: "line c0", d: `M${path(found, "middle")}` })] : [area];
  });
}

function chart(name, trend, changes) {
  const [width, height, left, bottom, top, right] = [room($("trend")), 290, 70, 34, 44, 14];
  const all = trend.map(one => ({ ...one, at: began(one.run), half: 1.96 * (one.std ?? 0) }));
  const determined = all.filter(point => point.determined);
  const points = $("determined").checked ? determined : all;
  if (!points.length) return [element("p", { textContent: `No run determines ${name} by itself.` })];
  // an undetermined one's error bar reaches its bounds and says nothing of the scale
  const scaled = determined.length ? determined : points;
  let low = Math.min(...scaled.map(point => point.value - point.half)), high = Math.max(...scaled.map(point => point.value + point.half));
  if (low === high) [low, high] = [low - Math.abs(low || 1) * 0.05, high + Math.abs(high || 1) * 0.05];
  const [first, last] = [points[0].at, points.at(-1).at];
  const x = at => last === first ? (left + width - right) / 2 : left + (at - first) / (last - first) * (width - left - right);
  const y = value => Math.min(height - bottom, Math.max(top, height - bottom - (value - low) / (high - low) * (height - bottom - top)));
  const { found: rows, digits } = ticks(low, high, 4);
  const parts = rows.flatMap(tick => [
    svg("line", { class: "axis", x1: left, x2: width - right, y1: y(tick), y2: y(tick) }),
    svg("text", { x: left - 8, y: y(tick) + 4, "text-anchor": "end" }, Math.abs(high) < 1e-3 ? tick.toExponential(1) : tick.toFixed(digits)),
  ]);
  const { unit, lower, upper } = points.at(-1);
  for (const [bound, word] of [[lower, "lower"], [upper, "upper"]]) {
    if (bound < low || bound > high) continue;
    parts.push(svg("line", { class: "bound", x1: left, x2: width - right, y1: y(bound), y2: y(bound) }, svg("title", {}, `${word} bound: ${tell(bound, unit)}`)));
  }
  parts.push(svg("text", { x: 2, y: 12 }, unit === "1" ? "no unit" : unit || "unit not known"),
    svg("text", { x: width - right, y: 12, "text-anchor": "end" }, `sought from ${tell(lower, unit)} to ${tell(upper, unit)}`));
  const day = at => new Date(at).toLocaleDateString();
  parts.push(svg("text", { x: left, y: height - 10 }, day(first)));
  if (day(last) !== day(first)) parts.push(svg("text", { x: width - right, y: height - 10, "text-anchor": "end" }, day(last)));
  const changed = marks(points, changes);
  changed.forEach(({ at, run, what }, i) => parts.push(svg("g", { class: "change" },
    svg("title", {}, `Model changed before run ${run}: ${what}`),
    svg("line", { x1: x(at), x2: x(at), y1: top - 8, y2: height - bottom }),
    svg("text", { x: x(at), y: top - 12, "text-anchor": "middle" }, i + 1))));
  parts.push(...drawn(points, x, y, width - left - right));
  const newest = points.at(-1);
  const label = `${name} over ${points.length} runs, ${determined.length} of ${all.length} determine it, newest ${tell(newest.value, unit)} +- ${newest.half.toPrecision(2)}; ` +
    `sought from ${tell(lower, unit)} to ${tell(upper, unit)}; the model was changed ${changed.length} times`;
  const figure = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, ...parts);
  const said = element("p", { textContent: `${determined.length} of ${all.length} runs determine it.` });
  if (!changed.length) return [figure, said];
  const skipped = Math.max(0, changed.length - LISTED_CHANGES);
  const items = changed.slice(skipped).map(({ run, what }, i) =>
    element("li", { value: skipped + i + 1, textContent: `${new Date(began(run)).toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" })}: ${what}` }));
  return [figure, said, element("p", { textContent: "Where the model was changed:" }), element("ol", { id: "changes" }, ...items)];
}
