// The map from above with its tools, and the views beside it.
import { moved, puts, shifted, snapped } from "./geometry.js";
import { overTime } from "./overtime.js";
import { Surface, element, key, same } from "./surface.js";

const $ = (id) => document.getElementById(id);

export class MapView extends Surface {
  constructor(app, svg, Tools) {
    super(app, svg);
    this.dragged = null; // a shape with other numbers than the file's, while it is dragged
    this.tools = new Tools(app, this);
    this.sides = [new SideView(app, $("side"), this)];
    $("fit").onclick = () => this.fit();
    $("closer").onclick = () => this.zoom(1.25);
    $("farther").onclick = () => this.zoom(0.8);
  }
  // everything that can be selected, with the numbers that it has while it is dragged
  all() {
    const state = this.app.state;
    if (!state) return [];
    const { shapes, start, target, starts = [] } = state.map;
    const list = shapes.map((shape, index) => ({ ...shape, index })).filter((shape) => !this.app.covered?.has(shape.name));
    if (target) list.push({ ...target, kind: "target", name: "", index: 0, entry: ["objective", "terminal"] });
    starts.forEach((place, index) => list.push({ ...place, kind: "member", index, heading: null }));
    if (start) list.push({ ...start, kind: "start", name: "", index: 0, entry: ["fleet", "start"] });
    const own = this.dragged;
    return own ? list.map((shape) => (same(shape, own) ? { ...shape, points: own.points ?? shape.points, at: own.at ?? shape.at, heading: own.heading ?? shape.heading, radius: own.radius ?? shape.radius } : shape)) : list;
  }
  // whether what is dragged is drawn elsewhere than the text has it
  ahead() {
    const own = this.dragged;
    if (!own) return false;
    const { shapes, start, target, starts } = this.app.state.map;
    const there = { start, target, member: starts[own.index] }[own.kind] || shapes[own.index];
    const numbers = ({ points, at, heading, radius }) => JSON.stringify([points, at, radius, heading && +heading.toFixed(6)]);
    return !there || numbers(own) !== numbers(there);
  }
  fit() {
    for (const surface of [this, ...this.sides]) surface.moved = false;
    this.refit();
    this.draw();
  }
  // show all of what is there now, but where someone moved the view
  refit() { for (const surface of [this, ...this.sides]) if (!surface.moved) surface.view = null; }
  draw() {
    if (!this.app.state) return;
    const { drawings } = this.app, { plane } = this.app.state.map;
    $("chart").hidden = !plane;
    this.paint();
    for (const side of this.sides) side.show();
    this.besides = plane || !drawings.length ? [] : [overTime(this.app, Math.max(this.svg.parentElement.parentElement.clientWidth - 24, 200))];
    $("others").replaceChildren(...this.besides.map((one) => one.figure));
    this.move();
  }
  // what goes with the time alone
  move() {
    for (const surface of [this, ...(this.sides || [])]) surface.follow();
    for (const one of this.besides || []) one.move();
  }
  hint() {
    const shape = this.selectedShape();
    $("hint").textContent = this.tools.hint(shape);
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
    const surface = this.sides.find((one) => one.svg.contains(event.target)) || this;
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (step && shape && !surface.fixed(shape) && event.target.type !== "range" && event.target.getAttribute?.("role") !== "tab") {
      const by = (this.tools.snap || 0.01) * (event.shiftKey ? 10 : 1);
      const [dx, dy] = step.map((one) => one * by);
      const value = shape.at ? shifted(shape.at, dx, dy, 0, surface.axes) : moved(shape, dx, dy, 0, surface.axes);
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

// Space from the side.
class SideView extends Surface {
  constructor(app, figure, main) {
    super(app, figure.querySelector("svg"));
    this.figure = figure;
    this.main = main;
    this.index = 1;
    this.axes = [0, 2];
    this.tools = { tool: "select", get snap() { return main.tools.snap; } };
  }
  get dragged() { return this.main.dragged; }
  set dragged(shape) { this.main.dragged = shape; }
  hint() { this.main.hint(); }
  draw() { this.main.draw(); }
  turn(...given) { return this.main.turn(...given); }
  all() {
    if (!this.app.state) return [];
    const { seen } = this, areas = seen ? seen.areas : [];
    const pieces = ({ kind, name }) => areas.filter((one) => one.name === name && one.kind === kind).map((one) => one.corners);
    // what can't be edited here is drawn as the plan's problem has it; what only one of several plans has, with that plan
    if (this.app.readonly) return areas.filter((one) => !(seen.own || []).some((own) => own.kind === one.kind && own.name === one.name) && !this.app.covered?.has(one.name)).map((one, index) => ({ ...one, index, form: "fixed", points: [], pieces: [one.corners] }));
    return this.main.all().map((shape) => (!shape.at && this.fixed(shape) ? { ...shape, form: "fixed", pieces: pieces(shape) } : shape));
  }
  show() {
    const { start } = this.app.state.map, { seen } = this;
    const space = seen ? Boolean(seen.hidden) : Boolean(start && start.at.length === 3);
    this.figure.hidden = !space;
    if (!space) return;
    const [across, up] = seen ? seen.axes : ["x [m]", "z [m]"];
    this.figure.querySelector("figcaption").textContent = `${up} over ${across}, seen along ${seen ? seen.hidden : "y"}`;
    this.paint();
  }
}

export { element, key, same };
