// The map: what the file has, editable; what the plan does, over it.
import { area, corners, moved, puts, snapped, ticks } from "./geometry.js";
import { Gestures } from "./gestures.js";

const NS = "http://www.w3.org/2000/svg";
const HANDLES = [[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]];
const CURSORS = ["nesw-resize", "ns-resize", "nwse-resize", "ew-resize", "nesw-resize", "ns-resize", "nwse-resize", "ew-resize"];
export const ARROW = 46; // pixels from the start to the handle that turns it

export class MapView {
  constructor(app, svg, Tools) {
    this.app = app;
    this.svg = svg;
    this.view = null; // {x, y, scale}: metres at the lower left corner, pixels per metre
    this.dragged = null; // a shape with other numbers than the file's, while it is dragged
    this.sketch = null; // what is being drawn
    this.last = this.width; // of the drawing
    this.tools = new Tools(app, this);
    this.gestures = new Gestures(app, this);
    new ResizeObserver(() => {
      // as much as a scroll bar takes leaves the view as it is
      if (!this.moved && Math.abs(this.width - this.last) > 40) this.view = null;
      this.last = this.width;
      this.draw();
    }).observe(svg);
    document.getElementById("fit").onclick = () => this.fit();
    document.getElementById("closer").onclick = () => this.zoom(1.25);
    document.getElementById("farther").onclick = () => this.zoom(0.8);
  }
  get width() { return this.svg.clientWidth || 600; }
  get height() { return this.svg.clientHeight || 480; }

  // everything that can be selected, with the numbers that it has while it is dragged
  all() {
    const state = this.app.state;
    if (!state) return [];
    const { shapes, start, target } = state.map;
    const list = shapes.map((shape, index) => ({ ...shape, index }));
    if (target) list.push({ ...target, kind: "target", name: "", index: 0, entry: ["objective", "terminal"] });
    if (start) list.push({ ...start, kind: "start", name: "", index: 0, entry: ["fleet", "start"] });
    const own = this.dragged;
    return own ? list.map((shape) => (same(shape, own) ? { ...shape, points: own.points ?? shape.points, at: own.at ?? shape.at, heading: own.heading ?? shape.heading, radius: own.radius ?? shape.radius } : shape)) : list;
  }
  // whether what is dragged is drawn elsewhere than the text has it
  ahead() {
    const own = this.dragged;
    if (!own) return false;
    const { shapes, start, target } = this.app.state.map;
    const there = own.kind === "start" ? start : own.kind === "target" ? target : shapes[own.index];
    const numbers = ({ points, at, heading, radius }) => JSON.stringify([points, at, radius, heading && +heading.toFixed(6)]);
    return !there || numbers(own) !== numbers(there);
  }
  selectedShape() {
    const chosen = this.app.selection;
    return chosen ? this.all().find((shape) => same(shape, chosen)) : undefined;
  }
  at(point) { return [(point[0] - this.view.x) * this.view.scale, this.height - (point[1] - this.view.y) * this.view.scale]; }
  metres(event) {
    const box = this.svg.getBoundingClientRect();
    return [this.view.x + (event.clientX - box.left) / this.view.scale, this.view.y + (box.bottom - event.clientY) / this.view.scale];
  }
  fit() { this.view = null; this.moved = false; this.draw(); }
  zoom(factor, at) {
    const [x, y] = at || [this.view.x + this.width / 2 / this.view.scale, this.view.y + this.height / 2 / this.view.scale];
    const scale = Math.min(1e5, Math.max(1e-3, this.view.scale * factor));
    this.view = { scale, x: x - (x - this.view.x) * this.view.scale / scale, y: y - (y - this.view.y) * this.view.scale / scale };
    this.moved = true;
    this.draw();
  }
  framed() {
    const points = this.all().flatMap((shape) => shape.at ? [shape.at] : shape.form === "fixed" ? (shape.pieces || []).flat() : corners(shape));
    for (const { drawing } of this.app.drawings) {
      if (drawing.views[0].axes[0] !== "t [s]") points.push(...drawing.views[0].ways.flatMap((way) => way.filter((_, k) => k % 8 === 0)));
    }
    if (this.app.points && this.app.drawings.length) points.push(...this.app.points(this.app.drawings[0].drawing.views[0]));
    if (points.length < 2) points.push([-1, -1], [7, 6]);
    const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    const low = [Math.min(...xs), Math.min(...ys)], high = [Math.max(...xs), Math.max(...ys)];
    const size = [Math.max(high[0] - low[0], 0.5), Math.max(high[1] - low[1], 0.5)];
    const scale = Math.min((this.width - 70) / size[0], (this.height - 60) / size[1]);
    return { scale, x: (low[0] + high[0]) / 2 - (this.width / 2 + 12) / scale, y: (low[1] + high[1]) / 2 - (this.height / 2 + 8) / scale };
  }

  draw() {
    if (!this.app.state) return;
    this.view = this.view || this.framed();
    const shapes = this.all();
    const chosen = this.app.selection;
    const { drawings, fresh } = this.app, { plane } = this.app.state.map;
    const view = drawings.length ? drawings[0].drawing.views[0] : null;
    const layer = (parts) => (plane && view ? [element("g", { class: `plan${fresh ? "" : " old"}` }, parts)] : []);
    this.dots = [];
    document.getElementById("chart").hidden = !plane;
    const focused = this.svg.contains(document.activeElement) ? document.activeElement.dataset.key : null;
    // the larger below the smaller; obstacles above regions, but in space, where they may be far above or below them
    const space = Boolean(view && view.hidden);
    const areas = shapes.filter((s) => s.form).sort((a, b) => area(b) - area(a));
    const below = [...this.grid(), ...areas.filter((s) => space || s.kind !== "obstacle").map((s) => this.area(s, chosen))];
    this.svg.classList.toggle("space", space);
    const plan = layer(drawings.flatMap((one) => [...this.tube(one), ...this.ways(one)]));
    const above = areas.filter((s) => !space && s.kind === "obstacle").map((s) => this.area(s, chosen));
    const moving = view ? this.moving(view, shapes) : [];
    const others = view && view.starts.length > 1 && fresh ? view.starts.map((place) => {
      const [cx, cy] = this.at(place);
      return element("circle", { class: "start", cx, cy, r: 4 });
    }) : [];
    const points = [...others, ...shapes.filter((s) => s.at).map((s) => this.point(s, chosen))];
    const live = layer(this.app.live ? this.app.live(view, (point) => this.at(point), this.view.scale) : []);
    const dots = layer(drawings.flatMap((one) => [...this.members(one), ...this.marks(one.drawing.views[0])]));
    const names = shapes.filter((s) => s.name).map((s) => this.name(s));
    const handles = shapes.filter((s) => same(s, chosen)).flatMap((s) => this.handles(s));
    this.svg.replaceChildren(...below, ...plan, ...above, ...moving, ...points, ...names, ...live, ...dots, ...handles, ...this.drawnNow());
    this.svg.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    if (focused) this.svg.querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus();
    this.passive();
    this.move();
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
    const outlines = shape.form === "fixed" ? shape.pieces || [] : [corners(shape)];
    const polygons = outlines.map((outline) => element("polygon", { class: { region: "region", zone: "region zoned" }[shape.kind] || "", points: this.text(outline) }));
    return this.tagged(element("g", { class: shape.kind }, polygons), shape, chosen);
  }
  tagged(group, shape, chosen) {
    group.dataset.key = key(shape);
    group.dataset.name = shape.name || shape.kind;
    group.classList.add("shape");
    group.classList.toggle("chosen", same(shape, chosen));
    group.classList.toggle("fixed", shape.form === "fixed");
    group.setAttribute("tabindex", "0");
    group.setAttribute("role", "button");
    group.setAttribute("aria-label", `${shape.kind} ${shape.name || ""}`.trim());
    return group;
  }
  point(shape, chosen) {
    const [x, y] = this.at(shape.at);
    let mark;
    if (shape.kind === "target") mark = element("path", { class: "target", d: `M${x - 8} ${y}h16M${x} ${y - 8}v16` });
    else if (shape.heading === null) mark = element("circle", { class: "start", cx: x, cy: y, r: 7 });
    else {
      const angle = -shape.heading * 180 / Math.PI;
      mark = element("path", { class: "start", transform: `translate(${x} ${y}) rotate(${angle})`, d: "M13 0L-9 8L-5 0L-9 -8Z" });
    }
    const room = element("circle", { class: "grip", cx: x, cy: y, r: 14 });
    return this.tagged(element("g", { class: `spot ${shape.kind}-spot` }, [room, mark]), shape, chosen);
  }
  name(shape) {
    const outline = shape.form === "fixed" ? (shape.pieces || [])[0] : corners(shape);
    if (!outline || !outline.length) return element("g", {});
    if (shape.kind !== "obstacle") {
      const top = outline.reduce((best, p) => (p[1] > best[1] ? p : best));
      const middle = outline.reduce((sum, p) => sum + p[0], 0) / outline.length;
      const [x, y] = this.at([middle, top[1]]);
      return element("text", { class: "mid name", x, y: Math.max(y - 5, 12) }, [shape.name]);
    }
    const [x, y] = this.at([0, 1].map((k) => outline.reduce((sum, p) => sum + p[k], 0) / outline.length));
    return element("text", { class: "mid on", x, y: y + 4 }, [shape.name]);
  }
  tube({ drawing, colour }) {
    return drawing.views[0].tube.map((slice) => element("path", { class: "tube", fill: colour || slice.colour, d: slice.rings.map((ring) => `M${this.text(ring)}Z`).join("") }));
  }
  ways({ drawing, colour, dash, name }) {
    return drawing.views[0].ways.map((way, i) => {
      const words = [name, drawing.members[i]].filter(Boolean).join(": ");
      return element("polyline", { class: "path", points: this.text(way), stroke: colour || drawing.colours[i], "stroke-dasharray": dash || "" }, [element("title", {}, [words])]);
    });
  }
  members({ drawing, colour }) {
    const r = Math.max(4, drawing.radius * this.view.scale);
    return drawing.views[0].ways.map((way, i) => {
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
      const outlines = shape.form === "fixed" ? shape.pieces || [] : [corners(shape)];
      const group = element("g", { class: "ghost" }, outlines.map((outline) => element("polygon", { points: this.text(outline) })));
      this.ghosts.push([group, view.moving[shape.name]]);
      return group;
    });
  }
  // what goes with the time alone
  move() {
    if (!this.view || !this.app.drawings.length) return;
    for (const [dot, way, drawing] of this.dots || []) {
      const [cx, cy] = this.at(this.app.player.at(way, drawing));
      dot.setAttribute("cx", cx.toFixed(1));
      dot.setAttribute("cy", cy.toFixed(1));
    }
    for (const [group, offsets] of this.ghosts || []) {
      const [dx, dy] = this.app.player.at(offsets, this.app.drawings[0].drawing);
      group.setAttribute("transform", `translate(${dx * this.view.scale} ${-dy * this.view.scale})`);
    }
    for (const move of this.besides || []) move();
  }
  handles(shape) {
    if (shape.kind === "start") {
      if (shape.heading === null) return [];
      const [x, y] = this.at(shape.at);
      const end = [x + ARROW * Math.cos(shape.heading), y - ARROW * Math.sin(shape.heading)];
      return [element("line", { class: "stem", x1: x, y1: y, x2: end[0], y2: end[1] }), this.handle(end, "turn", "grab")];
    }
    if (shape.form === "box") {
      const [[left, right], [low, high]] = shape.points;
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
  // further views of a plan, as those of space from the side, and the only one of a line
  passive() {
    const { drawings } = this.app, first = drawings.length ? drawings[0].drawing.views : [];
    this.besides = [];
    const figures = first.flatMap((_, k) => (k > 0 || !this.app.state.map.plane ? [this.beside(drawings, k)] : []));
    document.getElementById("others").replaceChildren(...figures);
  }
  beside(drawings, k) {
    const view = drawings[0].drawing.views[k], timed = view.axes[0] === "t [s]";
    const width = Math.max(this.svg.parentElement.parentElement.clientWidth - 24, 200), height = width * 0.5;
    const points = drawings.flatMap(({ drawing }) => [...drawing.views[k].ways.flat(), ...drawing.views[k].areas.flatMap((area) => area.corners), ...drawing.views[k].starts]);
    if (this.app.points) points.push(...this.app.points(view));
    if (timed) points.push([0, points[0][1]], [Math.max(...drawings.map(({ drawing }) => drawing.duration)), points[0][1]]);
    const low = [0, 1].map((i) => Math.min(...points.map((p) => p[i]))), high = [0, 1].map((i) => Math.max(...points.map((p) => p[i])));
    const each = [0, 1].map((i) => [width - 60, height - 50][i] / Math.max(high[i] - low[i], 1e-6));
    const [sx, sy] = timed ? each : [Math.min(...each), Math.min(...each)];
    const at = (p) => [40 + (p[0] - low[0]) * sx, height - 30 - (p[1] - low[1]) * sy];
    const text = (list) => list.map((p) => at(p).map((v) => v.toFixed(1)).join(",")).join(" ");
    const parts = [], dots = [];
    for (const value of ticks(low[0], high[0], 6)) parts.push(element("text", { class: "mid", x: at([value, 0])[0], y: height - 12 }, [String(value)]));
    for (const value of ticks(low[1], high[1], 5)) parts.push(element("text", { x: 2, y: at([low[0], value])[1] + 4 }, [String(value)]));
    for (const area of view.areas) parts.push(element("g", { class: area.kind }, [element("polygon", { class: area.kind === "region" ? "region" : "", points: text(area.corners) }, [element("title", {}, [area.name])])]));
    for (const { drawing, colour, dash } of drawings) {
      const seen = drawing.views[k];
      for (const slice of seen.tube) parts.push(element("path", { class: "tube", fill: colour || slice.colour, d: slice.rings.map((ring) => `M${text(ring)}Z`).join("") }));
      seen.ways.forEach((way, i) => {
        parts.push(element("polyline", { class: "path", points: text(way), stroke: colour || drawing.colours[i], "stroke-dasharray": dash || "" }));
        dots.push([element("circle", { class: "member", r: 4, fill: colour || drawing.colours[i] }), way, drawing]);
      });
    }
    if (this.app.live) parts.push(...this.app.live(view, at, Math.min(sx, sy)));
    this.besides.push(() => dots.forEach(([dot, way, drawing]) => {
      const [cx, cy] = at(this.app.player.at(way, drawing));
      dot.setAttribute("cx", cx.toFixed(1));
      dot.setAttribute("cy", cy.toFixed(1));
    }));
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    caption.textContent = `${view.axes[1]} over ${view.axes[0]}${view.hidden ? `, seen along ${view.hidden}` : ""}`;
    figure.className = `plan${this.app.fresh ? "" : " old"}`;
    figure.append(caption, element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img" }, [...parts, ...dots.map(([dot]) => dot)]));
    return figure;
  }

  hint() {
    const shape = this.selectedShape();
    document.getElementById("hint").textContent = this.tools.hint(shape);
  }
  // the start turned to some degrees from +x
  turn(degrees, group, dragging) {
    const { clockwise } = this.app.state.map.start;
    const value = +(clockwise ? 90 - degrees : degrees).toFixed(4);
    return this.app.edit([{ do: "put", path: ["fleet", "start", "heading"], value: `${value} deg` }], group, dragging);
  }
  remove() {
    const shape = this.selectedShape();
    if (!shape || shape.kind === "start") return;
    this.app.select(null);
    this.app.edit([{ do: "remove", path: shape.entry }]);
  }
  key(event) {
    const shape = this.selectedShape();
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (step && shape && shape.form !== "fixed" && event.target.type !== "range" && event.target.getAttribute?.("role") !== "tab") {
      const by = (this.tools.snap || 0.01) * (event.shiftKey ? 10 : 1);
      const [dx, dy] = step.map((one) => one * by);
      const value = shape.at ? shape.at.map((v, k) => (k < 2 ? snapped(v + [dx, dy][k], 0) : v)) : moved(shape, dx, dy, 0);
      this.app.edit(puts(shape, value), `keys ${key(shape)}`);
      event.preventDefault();
    } else if ((event.key === "Delete" || event.key === "Backspace") && shape) {
      this.remove();
      event.preventDefault();
    } else if (event.key === "Escape") {
      this.sketch = null;
      this.tools.choose("select");
      this.app.select(null);
    } else if (event.key === "Enter" && this.sketch) this.gestures.close();
    else if (event.key === "0") this.fit();
    else if (event.key === "+") this.zoom(1.25);
    else if (event.key === "-") this.zoom(0.8);
    else this.tools.key(event.key);
  }
}

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
