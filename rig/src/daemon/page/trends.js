// How coefficients went from run to run, with marks where the model was changed.

import { $, ask, element } from "./api.js";
import { room, svg } from "./chart.js";

// More of them are not written out.
const MOST_CHANGES = 8;

export async function showCoefficients(inRig) {
  const names = await ask(inRig("/coefficients"));
  const kept = $("coefficients").value;
  $("coefficients").replaceChildren(...names.map(name => element("option", { value: name, textContent: name })));
  if (names.includes(kept)) $("coefficients").value = kept;
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

function chart(name, trend, changes) {
  const [width, height, left, bottom, top, right] = [room($("trend")), 270, 70, 34, 26, 14];
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
  if (day(last) !== day(first)) parts.push(svg("text", { x: width - right, y: height - 10, "text-anchor": "end" }, day(last)));
  const changed = marks(points, changes);
  changed.forEach(({ at, run, what }, i) => parts.push(svg("g", { class: "change" },
    svg("title", {}, `Model changed before run ${run}: ${what}`),
    svg("line", { x1: x(at), x2: x(at), y1: top - 8, y2: height - bottom }),
    svg("text", { x: x(at), y: top - 12, "text-anchor": "middle" }, i + 1))));
  for (const point of points) {
    parts.push(svg("g", { class: point.determined ? "" : "open" },
      svg("title", {}, `${point.run}: ${point.value.toPrecision(5)} +- ${point.half.toPrecision(2)} (95 %)${point.determined ? "" : ", not determined"}`),
      svg("line", { class: "band", x1: x(point.at), x2: x(point.at), y1: y(point.value - point.half), y2: y(point.value + point.half) }),
      svg("circle", { cx: x(point.at), cy: y(point.value), r: 4 })));
  }
  const newest = points.at(-1);
  const label = `${name} over ${points.length} runs, newest ${newest.value.toPrecision(4)} +- ${newest.half.toPrecision(2)}; the model was changed ${changed.length} times`;
  const drawn = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, ...parts);
  if (!changed.length) return [drawn];
  const skipped = Math.max(0, changed.length - MOST_CHANGES);
  const items = changed.slice(skipped).map(({ run, what }, i) =>
    element("li", { value: skipped + i + 1, textContent: `${new Date(began(run)).toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" })}: ${what}` }));
  return [drawn, element("p", { textContent: "Where the model was changed:" }), element("ol", { id: "changes" }, ...items)];
}
