// One view of the map, from above or from the side: what the file has, editable; what the plan does, over it.
// Whoever extends it knows what is there (`all`), and draws every view at once (`draw`).
import { area, corners, ticks } from "./geometry.js";
import { Gestures } from "./gestures.js";

const NS = "http://www.w3.org/2000/svg";
const HANDLES = [[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]];
const CURSORS = ["nesw-resize", "ns-resize", "nwse-resize", "ew-resize", "nesw-resize", "ns-resize", "nwse-resize", "ew-resize"];
const LINE = 15; // pixels from one name to the next below it
export const ARROW = 46; // pixels from the start to the handle that turns it

export class Surface {
  constructor(app, svg) {
    this.app = app;
    this.svg = svg;
    this.index = 0; // of the drawing's view
    this.axes = [0, 1]; // coordinates across and up
    this.view = null; // {x, y, scale}: metres at the lower left corner, pixels per metre
    this.sketch = null; // what is being drawn
    this.last = this.width; // of the drawing
    this.gestures = new Gestures(app, this);
    new ResizeObserver(() => {
      // as much as a scroll bar takes leaves the view as it is
      if (!this.moved && Math.abs(this.width - this.last) > 40) this.view = null;
      this.last = this.width;
      this.draw();
    }).observe(svg);
  }
  get width() { return this.svg.clientWidth || 600; }
  get height() { return this.svg.clientHeight || 480; }

  selectedShape() {
    const chosen = this.app.selection;
    return chosen ? this.all().find((shape) => same(shape, chosen)) : undefined;
  }
  at(point) { return [(point[0] - this.view.x) * this.view.scale, this.height - (point[1] - this.view.y) * this.view.scale]; }
  metres(event) {
    const box = this.svg.getBoundingClientRect();
    return [this.view.x + (event.clientX - box.left) / this.view.scale, this.view.y + (box.bottom - event.clientY) / this.view.scale];
  }
  // a place with all its coordinates
  spot(place) { return this.at(this.axes.map((k) => place[k])); }
  // whether only the text can change it, or another view
  fixed(shape) {
    if (shape.form === "fixed" || this.index === 0) return shape.form === "fixed";
    return shape.at ? shape.at.length < 3 : shape.form !== "box" || shape.points.length < 3;
  }
  outlines(shape) { return shape.form === "fixed" ? shape.pieces || [] : [corners(shape, this.axes)]; }
  zoom(factor, at) {
    const [x, y] = at || [this.view.x + this.width / 2 / this.view.scale, this.view.y + this.height / 2 / this.view.scale];
    const scale = Math.min(1e5, Math.max(1e-3, this.view.scale * factor));
    this.view = { scale, x: x - (x - this.view.x) * this.view.scale / scale, y: y - (y - this.view.y) * this.view.scale / scale };
    this.moved = true;
    this.draw();
  }
  framed() {
    const points = this.all().flatMap((shape) => shape.at ? [this.axes.map((k) => shape.at[k])] : this.outlines(shape).flat());
    for (const { drawing } of this.drawings) {
      const view = drawing.views[this.index];
      if (view.coordinates) points.push(...view.ways.flatMap((way) => way.filter((_, k) => k % 8 === 0)), ...view.starts);
    }
    if (this.app.points && this.seen) points.push(...this.app.points(this.seen));
    if (points.length < 2) points.push([-1, -1], [7, 6]);
    const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    const low = [Math.min(...xs), Math.min(...ys)], high = [Math.max(...xs), Math.max(...ys)];
    const size = [Math.max(high[0] - low[0], 0.5), Math.max(high[1] - low[1], 0.5)];
    const scale = Math.min((this.width - 70) / size[0], (this.height - 60) / size[1]);
    return { scale, x: (low[0] + high[0]) / 2 - (this.width / 2 + 12) / scale, y: (low[1] + high[1]) / 2 - (this.height / 2 + 8) / scale };
  }

  // drawings that have this view: the last plan may be of a problem in the plane
  get drawings() { return this.app.drawings.filter(({ drawing }) => drawing.views.length > this.index); }
  get seen() { return this.drawings.length ? this.drawings[0].drawing.views[this.index] : null; }
  paint() {
    this.view = this.view || this.framed();
    const shapes = this.all();
    const chosen = this.app.selection;
    const { drawings } = this, { fresh } = this.app, { plane } = this.app.state.map;
    const view = this.seen;
    const layer = (parts) => (plane && view ? [element("g", { class: `plan${fresh ? "" : " old"}` }, parts)] : []);
    this.dots = [];
    const focused = this.svg.contains(document.activeElement) ? document.activeElement.dataset.key : null;
    // the larger below the smaller; obstacles above regions, but in space, where they may be far above or below them
    const space = Boolean(view && view.hidden);
    const areas = shapes.filter((s) => s.form).sort((a, b) => area(this.outlines(b)) - area(this.outlines(a)));
    const below = [...this.grid(), ...areas.filter((s) => space || s.kind !== "obstacle").map((s) => this.area(s, chosen))];
    this.svg.classList.toggle("space", space);
    const plan = layer(drawings.flatMap((one) => [...this.tube(one), ...this.ways(one)]));
    const above = areas.filter((s) => !space && s.kind === "obstacle").map((s) => this.area(s, chosen));
    const moving = view ? this.moving(view, shapes) : [];
    const points = [...(view ? this.ends(view) : []), ...shapes.filter((s) => s.at).map((s) => this.point(s, chosen))];
    const live = layer(this.app.live ? this.app.live(view, (point) => this.at(point), this.view.scale) : []);
    const dots = layer(drawings.flatMap((one) => [...this.members(one), ...this.marks(one.drawing.views[this.index])]));
    const placed = [], names = shapes.filter((s) => s.name && s.form).map((s) => this.name(s, placed));
    const handles = shapes.filter((s) => same(s, chosen)).flatMap((s) => this.handles(s));
    this.svg.replaceChildren(...below, ...plan, ...above, ...moving, ...points, ...names, ...live, ...dots, ...handles, ...this.drawnNow());
    this.svg.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    this.painting = true; // what had the focus has it again, which chooses nothing
    if (focused) this.svg.querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus();
    this.painting = false;
  }
  // starts and target that the file does not have as numbers
  ends(view) {
    const { starts, target } = this.app.ends(view, this.index);
    const dots = starts.map((place) => {
      const [cx, cy] = this.at(place);
      return element("circle", { class: "start", cx, cy, r: 4 });
    });
    return target ? [...dots, cross(...this.at(target))] : dots;
  }
  text(points) { return points.map((p) => this.at(p).map((v) => v.toFixed(1)).join(",")).join(" "); }

  grid() {
    const { x, y, scale } = this.view, right = x + this.width / scale, top = y + this.height / scale;
    const parts = [];
    for (const value of ticks(x, right, Math.max(3, this.width / 90))) {
      const [px] = this.at([value, 0]);
      parts.push(element("line", { class: "grid", x1: px, x2: px, y1: 0, y2: this.height }));
      parts.push(element("text", { class: "mid", x: px, y: this.height - 5 }, [String(value)]));
    }
    for (const value of ticks(y, top, Math.max(3, this.height / 80))) {
      const py = this.at([0, value])[1];
      parts.push(element("line", { class: "grid", x1: 0, x2: this.width, y1: py, y2: py }));
      if (py > 16) parts.push(element("text", { x: 4, y: py - 3 }, [String(value)]));
    }
    return parts;
  }
  area(shape, chosen) {
    const polygons = this.outlines(shape).map((outline) => element("polygon", { class: { region: "region", zone: "region zoned" }[shape.kind] || "", points: this.text(outline) }));
    return this.tagged(element("g", { class: shape.kind }, polygons), shape, chosen);
  }
  tagged(group, shape, chosen) {
    group.dataset.key = key(shape);
    group.dataset.name = shape.name || shape.kind;
    group.classList.add("shape");
    group.classList.toggle("chosen", same(shape, chosen));
    group.classList.toggle("fixed", this.fixed(shape));
    group.setAttribute("tabindex", "0");
    group.setAttribute("role", "button");
    group.setAttribute("aria-label", `${shape.kind} ${shape.name || ""}`.trim());
    return group;
  }
  point(shape, chosen) {
    const [x, y] = this.spot(shape.at);
    let mark;
    if (shape.kind === "target") mark = cross(x, y);
    else if (shape.heading === null || this.index > 0) mark = element("circle", { class: "start", cx: x, cy: y, r: shape.kind === "member" ? 5 : 7 });
    else {
      const angle = -shape.heading * 180 / Math.PI;
      mark = element("path", { class: "start", transform: `translate(${x} ${y}) rotate(${angle})`, d: "M13 0L-9 8L-5 0L-9 -8Z" });
    }
    const member = shape.kind === "member"; // by its name it can be taken where another start is above it
    const room = element("circle", { class: "grip", cx: x, cy: y, r: member ? 10 : 14 });
    const name = member ? [element("text", { class: "member-name", x: x + 9, y: y - 9 }, [shape.name])] : [];
    return this.tagged(element("g", { class: `spot ${shape.kind}-spot` }, [room, mark, ...name]), shape, chosen);
  }
  // below names that are there already
  name(shape, placed) {
    const outline = this.outlines(shape)[0];
    if (!outline || !outline.length) return element("g", {});
    const middle = [0, 1].map((k) => outline.reduce((sum, p) => sum + p[k], 0) / outline.length), within = shape.kind === "obstacle";
    const top = outline.reduce((best, p) => (p[1] > best[1] ? p : best));
    let [x, y] = this.at(within ? middle : [middle[0], top[1]]);
    y = within ? y + 4 : Math.max(y - 5, 12);
    const wide = 4 * shape.name.length;
    while (placed.some((one) => Math.abs(one.x - x) < one.wide + wide && Math.abs(one.y - y) < LINE)) y += LINE;
    placed.push({ x, y, wide });
    return element("text", { class: within ? "mid on" : "mid name", x, y }, [shape.name]);
  }
  tube({ drawing, colour }) {
    return drawing.views[this.index].tube.map((slice) => element("path", { class: "tube", fill: colour || slice.colour, d: slice.rings.map((ring) => `M${this.text(ring)}Z`).join("") }));
  }
  ways({ drawing, colour, dash, name }) {
    return drawing.views[this.index].ways.map((way, i) => {
      const words = [name, drawing.members[i]].filter(Boolean).join(": ");
      return element("polyline", { class: "path", points: this.text(way), stroke: colour || drawing.colours[i], "stroke-dasharray": dash || "" }, [element("title", {}, [words])]);
    });
  }
  members({ drawing, colour }) {
    const r = Math.max(4, drawing.radius * this.view.scale);
    return drawing.views[this.index].ways.map((way, i) => {
      const dot = element("circle", { class: `member${r > 8 ? " large" : ""}`, r, fill: colour || drawing.colours[i] });
      this.dots.push([dot, way, drawing]);
      return dot;
    });
  }
  marks(view) {
    const ring = ({ at, text }) => {
      const [cx, cy] = this.at(at);
      return element("circle", { class: "mark", cx, cy, r: 9 }, [element("title", {}, [text])]);
    };
    const { counter } = view;
    const way = counter ? [element("polyline", { class: "counter", points: this.text(counter.way) }, [element("title", {}, [counter.text])])] : [];
    return [...way, ...view.marks.map(ring), ...(counter && counter.at ? [ring(counter)] : [])];
  }
  moving(view, shapes) {
    this.ghosts = [];
    return shapes.filter((shape) => view.moving[shape.name] && shape.kind === "obstacle").map((shape) => {
      const group = element("g", { class: "ghost" }, this.outlines(shape).map((outline) => element("polygon", { points: this.text(outline) })));
      this.ghosts.push([group, view.moving[shape.name]]);
      return group;
    });
  }
  // what goes with the time alone
  follow() {
    if (!this.view || !this.drawings.length) return;
    for (const [dot, way, drawing] of this.dots || []) {
      const [cx, cy] = this.at(this.app.player.at(way, drawing));
      dot.setAttribute("cx", cx.toFixed(1));
      dot.setAttribute("cy", cy.toFixed(1));
    }
    for (const [group, offsets] of this.ghosts || []) {
      const [dx, dy] = this.app.player.at(offsets, this.drawings[0].drawing);
      group.setAttribute("transform", `translate(${dx * this.view.scale} ${-dy * this.view.scale})`);
    }
  }
  handles(shape) {
    if (this.fixed(shape)) return [];
    if (shape.kind === "start") {
      if (shape.heading === null || this.index > 0) return [];
      const [x, y] = this.spot(shape.at);
      const end = [x + ARROW * Math.cos(shape.heading), y - ARROW * Math.sin(shape.heading)];
      return [element("line", { class: "stem", x1: x, y1: y, x2: end[0], y2: end[1] }), this.handle(end, "turn", "grab")];
    }
    if (shape.form === "box") {
      const [[left, right], [low, high]] = this.axes.map((k) => shape.points[k]);
      return HANDLES.map(([i, j], k) => this.handle(this.at([i < 0 ? left : i > 0 ? right : (left + right) / 2, j < 0 ? low : j > 0 ? high : (low + high) / 2]), `${i},${j}`, CURSORS[k]));
    }
    if (shape.form === "disc") {
      const [[x, y]] = shape.points;
      return [this.handle(this.at([x + shape.radius, y]), "radius", "ew-resize")];
    }
    if (shape.form === "polygon") {
      const between = shape.points.map((p, i) => {
        const q = shape.points[(i + 1) % shape.points.length];
        return this.handle(this.at([(p[0] + q[0]) / 2, (p[1] + q[1]) / 2]), `edge${i}`, "copy", "new");
      });
      return [...between, ...shape.points.map((p, i) => this.handle(this.at(p), `corner${i}`, "move"))];
    }
    return [];
  }
  handle([x, y], name, cursor, more) {
    const group = element("g", { class: `handle ${more || ""}` }, [
      element("circle", { class: "grip", cx: x, cy: y, r: 13 }), element("circle", { class: "knob", cx: x, cy: y, r: more ? 4 : 6 }),
    ]);
    group.dataset.handle = name;
    group.style.cursor = cursor;
    return group;
  }
  drawnNow() {
    if (!this.sketch) return [];
    const points = this.sketch.points;
    return [element(this.sketch.open ? "polyline" : "polygon", { class: `sketch ${this.sketch.kind}`, points: this.text(points) }),
      ...points.slice(0, this.sketch.open ? points.length : 0).map((p) => element("circle", { class: "knob", cx: this.at(p)[0], cy: this.at(p)[1], r: 4 }))];
  }
}

const cross = (x, y) => element("path", { class: "target", d: `M${x - 8} ${y}h16M${x} ${y - 8}v16` });
export const key = (shape) => `${shape.kind} ${JSON.stringify(shape.entry || [])}`;
export function same(shape, other) {
  return Boolean(shape && other && shape.kind === other.kind && shape.name === other.name && shape.index === other.index);
}
export function element(name, attributes, children) {
  const made = document.createElementNS(NS, name);
  for (const [attribute, value] of Object.entries(attributes)) if (value !== "") made.setAttribute(attribute, typeof value === "number" ? +value.toFixed(2) : value);
  made.append(...(children || []));
  return made;
}
