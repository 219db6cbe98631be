// Charts, drawn as SVG: their words are text, their colours those of the page.

export function svg(tag, attributes, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// Colours of lines; with more lines they come again, dashed.
const COLOURS = 6;
export const lineClass = place => `line c${place % COLOURS}${place >= COLOURS ? " dashed" : ""}`;

// Round numbers between `low` and `high`, about `count` of them.
export function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(factor => factor * power).find(step => step >= rough);
  const found = [];
  for (let at = Math.ceil(low / step); at * step <= high + step * 1e-9; at += 1) found.push(at * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// Points of more than a pixel's column can tell apart, `{ x, y }` in order of x: least, middle and greatest y of each column.
export function columns(points, columnWidth) {
  const found = new Map();
  for (const { x, y } of points) {
    const column = Math.floor(x / columnWidth);
    if (!found.has(column)) found.set(column, []);
    found.get(column).push(y);
  }
  return [...found].map(([column, ys]) => {
    ys.sort((a, b) => a - b);
    return { x: (column + 0.5) * columnWidth, low: ys[0], middle: ys[Math.floor(ys.length / 2)], high: ys.at(-1) };
  });
}

// How wide a chart in the element `place` is: its letters are as large as those of a legend, on a phone too.
export const room = place => Math.max(260, place.clientWidth);

// Lines over one axis: `lines` are `{ points: [[x, y], ...], place }`, a `y` of null is a gap. `log` spreads small values.
export function lineChart({ width, label, lines, from, to, unit, xUnit, log = false, least = 0 }) {
  const [height, left, bottom, top, right] = [190, 52, 26, 22, 10];
  const values = lines.flatMap(line => line.points.map(([, y]) => y).filter(y => y !== null && (!log || y > 0)));
  const scaled = log ? Math.log10 : value => value;
  let [low, high] = values.length ? [Math.min(...values), Math.max(...values)].map(scaled) : [0, 1];
  const span = 1.1 * (Math.max(high - low, least) || 1);
  [low, high] = [(low + high - span) / 2, (low + high + span) / 2];
  const x = at => left + (at - from) / (to - from || 1) * (width - left - right);
  const y = value => height - bottom - (scaled(value) - low) / (high - low) * (height - bottom - top);
  const parts = [];
  const [rows, columns] = [ticks(low, high, 4), ticks(from, to, width / 110)];
  for (const row of rows.found) {
    const value = log ? 10 ** row : row;
    parts.push(svg("line", { class: "axis", x1: left, x2: width - right, y1: y(value), y2: y(value) }),
      svg("text", { x: left - 7, y: y(value) + 4, "text-anchor": "end" }, log ? value.toPrecision(2) : row.toFixed(rows.digits)));
  }
  for (const at of columns.found)
    parts.push(svg("text", { x: x(at), y: height - 8, "text-anchor": "middle" }, at.toFixed(columns.digits)));
  parts.push(svg("text", { x: 2, y: 12 }, unit), svg("text", { x: width - right, y: 12, "text-anchor": "end" }, `over ${xUnit}`));
  for (const { points, place } of lines) {
    let path = "", pen = "M";
    for (const [at, value] of points) {
      if (value === null || log && value <= 0) { pen = "M"; continue; }
      path += `${pen}${x(at).toFixed(1)} ${y(value).toFixed(1)}`;
      pen = "L";
    }
    parts.push(svg("path", { class: lineClass(place), d: path }));
  }
  return svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": label }, ...parts);
}
