// Small parts of pages: elements, tables, charts, and places in a view.
import { ticks } from "./geometry.js";
import { element } from "./surface.js";

// a point with all its coordinates in a view: two of them, or one over time
export const seen = (view, point, time) => (view.coordinates ? view.coordinates.map((k) => point[k]) : [time, point[0]]);

export function html(name, attributes, children) {
  const made = document.createElement(name);
  Object.assign(made, attributes);
  made.append(...(children || []));
  return made;
}

export function table(names, rows, differing) {
  const head = html("tr", {}, ["", ...names].map((text) => html("th", { textContent: text, scope: "col" })));
  const body = rows.map(({ label, cells, differ }) => html("tr", { className: differ && differing ? "differ" : "" },
    [html("th", { textContent: label, scope: "row" }), ...cells.map((text) => html("td", { textContent: text }))]));
  return html("div", { className: `wide ${differing ? "" : "close"}` }, [html("table", {}, [html("thead", {}, [head]), html("tbody", {}, body)])]);
}

// A chart with one x axis: bands and lines of points, in SVG.
const WIDE = 460, HIGH = 150, LEFT = 52, BELOW = 22;
export function chart(title, { lines = [], bands = [], levels = [], log = false, unit = "" }) {
  const height = (value) => (log ? Math.log10(Math.max(value, 1e-12)) : value);
  const points = [...lines.flatMap((line) => line.points), ...bands.flatMap((band) => band.points.flatMap(([x, low, high]) => [[x, low], [x, high]])), ...levels.map((level) => [0, level])].filter(([, y]) => y !== null);
  if (!points.length) return html("figure", {});
  const xs = points.map((p) => p[0]), ys = points.map((p) => height(p[1]));
  const [left, right] = [Math.min(...xs), Math.max(...xs)];
  let [low, high] = [Math.min(...ys), Math.max(...ys)];
  if (high - low < 1e-9) { low -= 0.5; high += 0.5; }
  const at = (x, y) => [LEFT + (x - left) / (right - left || 1) * (WIDE - LEFT - 8), HIGH - BELOW - (height(y) - low) / (high - low) * (HIGH - BELOW - 10)];
  const text = (list) => list.map(([x, y]) => at(x, y).map((v) => v.toFixed(1)).join(",")).join(" ");
  const parts = [];
  const shown = (value) => (log ? (10 ** value).toExponential(0) : +value.toPrecision(3));
  for (const value of log ? [low, high] : ticks(low, high, 3)) {
    const y = HIGH - BELOW - (value - low) / (high - low) * (HIGH - BELOW - 10);
    parts.push(element("line", { class: "grid", x1: LEFT, x2: WIDE, y1: y, y2: y }), element("text", { class: "end", x: LEFT - 5, y: y + 4 }, [String(shown(value))]));
  }
  for (const value of ticks(left, right || left + 1, 5)) parts.push(element("text", { class: "mid", x: at(value, log ? 10 ** low : low)[0], y: HIGH - 5 }, [String(value)]));
  bands.forEach(({ points: list }, k) => parts.push(element("polygon", { class: `area c${k % 6}`, points: text([...list.map(([x, a]) => [x, a]), ...list.map(([x, , b]) => [x, b]).reverse()]) })));
  lines.forEach(({ points: list, name }, k) => parts.push(element("polyline", { class: `line c${k % 6}`, points: text(list.filter(([, y]) => y !== null)) }, [element("title", {}, [name || ""])])));
  for (const level of levels) {
    const [, y] = at(left, level);
    parts.push(element("line", { class: "level bound", x1: LEFT, x2: WIDE, y1: y, y2: y }));
  }
  return html("figure", {}, [html("figcaption", { textContent: unit ? `${title} [${unit}]` : title }), element("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img", "aria-label": title }, parts)]);
}
