// Presses, drags, the wheel and two fingers on the map.
import { corners, moved, puts, resized, shifted, snapped } from "./geometry.js";
import { key } from "./surface.js";

const CLOSE = 12; // pixels from the first corner that close a polygon
const DEGREES = 5; // steps of the heading, where snapping is on

export class Gestures {
  constructor(app, map) {
    this.app = app;
    this.map = map;
    this.fingers = new Map();
    this.count = 0;
    const svg = map.svg;
    svg.addEventListener("pointerdown", (event) => this.down(event));
    svg.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) svg.addEventListener(name, (event) => this.up(event));
    svg.addEventListener("wheel", (event) => {
      event.preventDefault();
      map.zoom(Math.exp(-event.deltaY / 400), map.metres(event));
    }, { passive: false });
    svg.addEventListener("focusin", (event) => {
      if (this.app.readonly || map.painting) return;
      const group = event.target.closest(".shape");
      if (group && !this.drag) this.choose(group.dataset.key);
    });
  }
  choose(wanted) {
    const shape = this.map.all().find((one) => key(one) === wanted);
    const chosen = this.map.selectedShape();
    if (shape && (!chosen || key(chosen) !== wanted)) this.app.select({ kind: shape.kind, name: shape.name, index: shape.index });
    return shape;
  }
  down(event) {
    if (event.button > 0) return;
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    this.map.svg.setPointerCapture(event.pointerId);
    const at = this.map.metres(event);
    if (this.fingers.size === 2) { this.drag = null; this.map.dragged = null; this.spread = this.distance(); return; }
    const { tool } = this.map.tools;
    if (tool !== "select") return this.begin(tool, at, event);
    const changing = this.app.readonly ? null : event.target;
    const handle = changing?.closest("[data-handle]"), group = changing?.closest(".shape");
    event.preventDefault();
    if (handle) {
      const shape = this.map.selectedShape();
      const name = handle.dataset.handle;
      if (event.altKey && name.startsWith("corner")) return this.without(shape, +name.slice(6));
      this.grab(shape, at, name.startsWith("edge") ? this.newCorner(shape, +name.slice(4)) : name);
    } else if (group) {
      const shape = this.choose(group.dataset.key);
      this.map.hint();
      this.map.svg.querySelector(`[data-key="${CSS.escape(group.dataset.key)}"]`)?.focus({ preventScroll: true });
      if (!this.map.fixed(shape)) this.grab(shape, at, "move");
    } else {
      this.app.select(null);
      this.drag = { what: "pan", from: [event.clientX, event.clientY], view: { ...this.map.view } };
    }
  }
  grab(shape, from, what) {
    const begun = this.map.dragged || shape;
    this.drag = { what, from, shape: { ...shape, points: begun.points, at: begun.at }, group: `drag ${Date.now()} ${++this.count}` };
  }
  begin(tool, at, event) {
    const snap = event.altKey ? 0 : this.map.tools.snap;
    const point = at.map((value) => snapped(value, snap));
    const { kind } = this.map.tools;
    if (tool === "start") this.map.tools.putStart(point);
    else if (tool === "target") this.map.tools.putTarget(point);
    else if (tool === "waypoint") {
      const half = 0.3, side = (value) => [+(value - half).toFixed(6), +(value + half).toFixed(6)];
      this.map.tools.add({ box: this.flat(point.map(side)) }, "region", true);
    } else if (tool === "polygon") this.corner(point, kind);
    else this.drag = { what: tool, from: point, kind };
  }
  // a box has a height too where the fleet moves in space
  flat(sides) { return this.app.state.map.start && this.app.state.map.start.at.length === 3 ? [...sides, [0, 1]] : sides; }
  corner(point, kind) {
    const sketch = this.map.sketch || { kind, open: true, points: [] };
    const first = sketch.points[0];
    if (first && sketch.points.length > 2) {
      const [a, b] = [this.map.at(first), this.map.at(point)];
      if (Math.hypot(a[0] - b[0], a[1] - b[1]) < CLOSE) return this.close();
    }
    sketch.points.push(point);
    this.map.sketch = sketch;
    this.map.draw();
  }
  close() {
    const { sketch } = this.map;
    this.map.sketch = null;
    if (sketch.points.length > 2) this.map.tools.add({ polygon: sketch.points }, sketch.kind);
  }
  newCorner(shape, i) {
    const [p, q] = [shape.points[i], shape.points[(i + 1) % shape.points.length]];
    const points = [...shape.points];
    points.splice(i + 1, 0, [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2]);
    this.map.dragged = { ...shape, points };
    return `corner${i + 1}`;
  }
  without(shape, i) {
    if (shape.points.length > 3) this.app.edit([{ do: "put", path: shape.path, value: shape.points.filter((_, k) => k !== i) }]);
  }

  move(event) {
    if (this.fingers.has(event.pointerId)) this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (this.fingers.size === 2) return this.pinch();
    const { drag } = this;
    if (!drag) return;
    const at = this.map.metres(event), step = event.altKey ? 0 : this.map.tools.snap;
    if (drag.what === "pan") {
      const { view } = drag;
      this.map.view = { ...view, x: view.x - (event.clientX - drag.from[0]) / view.scale, y: view.y + (event.clientY - drag.from[1]) / view.scale };
      this.map.moved = true;
      return this.map.draw();
    }
    drag.moved = true;
    if (drag.what === "box" || drag.what === "disc") {
      const shape = this.drawn(drag, at, step);
      this.map.sketch = shape && { kind: drag.kind, points: corners(shape) };
      return this.map.draw();
    }
    this.map.dragged = this.changed(drag, at, step);
    this.map.draw();
    this.app.verdict();
    this.send(true);
  }
  // a new box or disc between where it was begun and here
  drawn({ what, from }, at, step) {
    const point = at.map((value) => snapped(value, step));
    if (what === "disc") {
      const radius = snapped(Math.hypot(at[0] - from[0], at[1] - from[1]), step);
      return radius > 0 ? { form: "disc", points: [from], radius } : null;
    }
    const sides = [0, 1].map((k) => [Math.min(from[k], point[k]), Math.max(from[k], point[k])]);
    return sides.every(([low, high]) => low < high) ? { form: "box", points: sides } : null;
  }
  // the dragged shape with its new numbers
  changed({ what, from, shape }, at, step) {
    const [dx, dy] = [at[0] - from[0], at[1] - from[1]];
    if (what === "turn") {
      const raw = Math.atan2(at[1] - shape.at[1], at[0] - shape.at[0]) * 180 / Math.PI;
      return { ...shape, heading: snapped(raw, step ? DEGREES : 0) * Math.PI / 180 };
    }
    const { axes } = this.map;
    if (shape.at) return { ...shape, at: shifted(shape.at, dx, dy, step, axes) };
    if (what === "radius") {
      const radius = snapped(Math.hypot(at[0] - shape.points[0][0], at[1] - shape.points[0][1]), step);
      return { ...shape, radius: Math.max(radius, step || 0.01) };
    }
    if (what === "move") return { ...shape, points: moved(shape, dx, dy, step, axes) };
    if (what.startsWith("corner")) {
      const i = +what.slice(6);
      return { ...shape, points: shape.points.map((corner, k) => (k === i ? at.map((value) => snapped(value, step)) : corner)) };
    }
    return { ...shape, points: resized(shape, what.split(",").map(Number), at[0], at[1], step, axes) };
  }
  send(dragging) {
    const { drag } = this, shape = this.map.dragged;
    if (drag.what === "turn") return this.map.turn(shape.heading * 180 / Math.PI, drag.group, dragging);
    return this.app.edit(puts(shape, shape.at || shape.points), drag.group, dragging);
  }
  async up(event) {
    this.fingers.delete(event.pointerId);
    const { drag } = this;
    if (!drag || event.type === "pointercancel") { this.drag = null; this.map.dragged = null; return; }
    if (drag.what === "box" || drag.what === "disc") {
      const shape = this.drawn(drag, this.map.metres(event), event.altKey ? 0 : this.map.tools.snap);
      this.drag = this.map.sketch = null;
      const value = shape && (shape.form === "box" ? this.flat(shape.points) : { center: shape.points[0], radius: shape.radius });
      if (shape) this.map.tools.add({ [shape.form]: value }, drag.kind);
      else this.map.draw();
      return;
    }
    if (drag.moved && drag.shape) {
      document.documentElement.dataset.dropped = performance.now();
      const done = this.send(false);
      this.drag = null;
      await done;
      if (!this.drag) this.map.dragged = null;
      this.map.draw();
      this.app.verdict();
    } else {
      this.map.dragged = null;
      this.drag = null;
      this.map.draw();
    }
  }
  distance() {
    const [a, b] = [...this.fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  }
  pinch() {
    const now = this.distance();
    const [a, b] = [...this.fingers.values()];
    const middle = this.map.metres({ clientX: (a[0] + b[0]) / 2, clientY: (a[1] + b[1]) / 2 });
    if (this.spread > 0) this.map.zoom(now / this.spread, middle);
    this.spread = now;
  }
}
