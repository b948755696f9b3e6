// A line over time: what is on it, and how a plan moves along.
import { ticks } from "./geometry.js";
import { element } from "./surface.js";

// the figure, and how it goes with the time
export function overTime(app, width) {
  const { drawings } = app, view = drawings[0].drawing.views[0], height = width * 0.5;
  const points = drawings.flatMap(({ drawing }) => [...drawing.views[0].ways.flat(), ...drawing.views[0].areas.flatMap((area) => area.corners), ...drawing.views[0].starts]);
  if (app.points) points.push(...app.points(view));
  points.push([0, points[0][1]], [Math.max(...drawings.map(({ drawing }) => drawing.duration)), points[0][1]]);
  const low = [0, 1].map((i) => Math.min(...points.map((p) => p[i]))), high = [0, 1].map((i) => Math.max(...points.map((p) => p[i])));
  const [sx, sy] = [0, 1].map((i) => [width - 60, height - 50][i] / Math.max(high[i] - low[i], 1e-6));
  const at = (p) => [40 + (p[0] - low[0]) * sx, height - 30 - (p[1] - low[1]) * sy];
  const text = (list) => list.map((p) => at(p).map((v) => v.toFixed(1)).join(",")).join(" ");
  const parts = [], dots = [];
  for (const value of ticks(low[0], high[0], 6)) parts.push(element("text", { class: "mid", x: at([value, 0])[0], y: height - 12 }, [String(value)]));
  for (const value of ticks(low[1], high[1], 5)) parts.push(element("text", { x: 2, y: at([low[0], value])[1] + 4 }, [String(value)]));
  for (const area of view.areas) parts.push(element("g", { class: area.kind }, [element("polygon", { class: area.kind === "region" ? "region" : "", points: text(area.corners) }, [element("title", {}, [area.name])])]));
  for (const { drawing, colour, dash } of drawings) {
    const [seen] = drawing.views;
    for (const slice of seen.tube) parts.push(element("path", { class: "tube", fill: colour || slice.colour, d: slice.rings.map((ring) => `M${text(ring)}Z`).join("") }));
    seen.ways.forEach((way, i) => {
      parts.push(element("polyline", { class: "path", points: text(way), stroke: colour || drawing.colours[i], "stroke-dasharray": dash || "" }));
      dots.push([element("circle", { class: "member", r: 4, fill: colour || drawing.colours[i] }), way, drawing]);
    });
  }
  if (app.live) parts.push(...app.live(view, at, Math.min(sx, sy)));
  const figure = document.createElement("figure"), caption = document.createElement("figcaption");
  caption.textContent = `${view.axes[1]} over ${view.axes[0]}`;
  figure.className = `plan${app.fresh ? "" : " old"}`;
  figure.append(caption, element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img" }, [...parts, ...dots.map(([dot]) => dot)]));
  const move = () => dots.forEach(([dot, way, drawing]) => {
    const [cx, cy] = at(app.player.at(way, drawing));
    dot.setAttribute("cx", cx.toFixed(1));
    dot.setAttribute("cy", cy.toFixed(1));
  });
  return { figure, move };
}
