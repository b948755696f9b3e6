// A loop that goes on: where robots may be and are to go, what is learnt, and what is proven.
import { element } from "./surface.js";
import { chart, html, seen } from "./parts.js";

const PROOFS = { whole: ["good", "The rest of the task is proven"], period: ["open", "Proven until the next plan takes over"], none: ["bad", "Nothing is proven"] };
const ENDINGS = { success: "good", finished: "open", failed: "bad", stopped: "bad", interrupted: "open" };

export class Loop {
  constructor(app, place, state) {
    this.app = app;
    this.place = place;
    this.scene = { drawing: state.scene };
    this.steps = [];
    this.covered = new Set(); // obstacles that are drawn as the loop knows them
    this.past = {}; // of each robot: times, places and the radius of the set of places
    this.first = null;
    this.phase = "";
    this.ending = null;
    this.wanted = false;
    this.show();
    queueMicrotask(() => this.app.player.of([state.scene]));
  }
  get drawings() { return [this.scene]; }
  event(event) {
    if (event.kind === "phase") this.phase = event.phase;
    else if (event.kind === "first") {
      this.first = event;
      this.app.map.refit();
    }
    else if (event.kind === "step") this.take(event);
    else if (event.kind === "outcome") {
      this.ending = event;
      this.take(event);
    }
    else if (event.kind === "done") this.done = true;
    else return;
    if (event.kind === "step") this.app.player.to(Math.min(1, event.time / this.scene.drawing.duration));
    this.show();
  }
  take(event) {
    if (event.kind === "step") this.steps.push(event);
    this.newest = event;
    const before = this.covered;
    this.covered = new Set(Object.keys(event.obstacles));
    if ([...this.covered].some((name) => !before.has(name))) this.app.map.refit();
    for (const [name, robot] of Object.entries(event.robots)) this.past[name] = [...(this.past[name] || []), ...robot.past];
  }
  // what a map has to show besides the problem
  points(view) {
    const ways = this.first ? this.first.ways.flatMap((way) => way.map((p, k) => seen(view, p, k * this.first.step))) : [];
    const outlines = this.newest ? Object.values(this.newest.obstacles).flatMap((one) => (one.outlines[String(view.coordinates)] || []).flat()) : [];
    return [...ways, ...outlines];
  }
  show() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => { this.wanted = false; this.drawn(); });
  }
  drawn() {
    this.verdict();
    this.app.map.draw();
    const parts = [html("h2", { textContent: "Proof" }), this.proofs()];
    const last = this.steps[this.steps.length - 1];
    if (last) {
      parts.push(html("h2", { textContent: "What is known" }));
      for (const name of Object.keys(last.ranges)) {
        const points = this.steps.filter((one) => one.ranges[name]).map((one) => [one.time, ...one.ranges[name]]);
        const [low, high] = last.ranges[name];
        parts.push(chart(`${name}: ${low.toPrecision(4)} to ${high.toPrecision(4)}, over seconds`, { bands: [{ points: stairs([...points, [last.end, low, high]]) }] }));
      }
      parts.push(chart("Planning, over seconds", { unit: "ms", levels: [1000 * last.deadline], lines: [{ points: this.steps.map((one) => [one.time, 1000 * one.seconds]) }] }));
      const events = this.steps.flatMap((one) => one.events.map((text) => `t = ${one.time.toFixed(1)} s: ${text}`));
      if (events.length) parts.push(html("h2", { textContent: "Events" }), html("ul", { className: "found" }, events.map((text) => html("li", { className: "warning", textContent: text }))));
    }
    this.place.replaceChildren(...parts);
  }
  // one cell for each step, in the colour of what is proven
  proofs() {
    const total = this.scene.drawing.duration, end = Math.max(total, ...this.steps.map((one) => one.end));
    const cells = this.steps.map((one) => {
      const [kind, words] = PROOFS[one.proof];
      const x = 100 * one.time / end, width = 100 * (one.end - one.time) / end;
      return element("rect", { class: `proof ${kind}`, x, y: 0, width: Math.max(width - 0.15, 0.1), height: 8 }, [element("title", {}, [`t = ${one.time.toFixed(1)} s: ${words}; ${one.source} plan`])]);
    });
    const last = this.steps[this.steps.length - 1];
    const words = last ? `${PROOFS[last.proof][1]}: clearance ${metres(last.clearance)}, robustness ${metres(last.robustness)} (${last.source} plan).` : "There is no step yet.";
    return html("div", {}, [element("svg", { class: "proofs", viewBox: "0 0 100 8", preserveAspectRatio: "none", role: "img", "aria-label": "What was proven in each step" }, cells), html("p", { className: "note", textContent: words })]);
  }
  verdict() {
    const last = this.steps[this.steps.length - 1];
    if (this.ending) return this.app.verdict(`${this.ending.ending}: ${this.ending.reason}`, ENDINGS[this.ending.ending] || "open", false);
    if (this.done) return this.app.verdict("the command ended without a run", "bad", false);
    if (!last) return this.app.verdict(this.phase || "starting", "open", true);
    return this.app.verdict(`at t = ${last.time.toFixed(1)} s: ${PROOFS[last.proof][1].toLowerCase()}`, PROOFS[last.proof][0], true);
  }
  live(view, at, scale) {
    const line = (points, attributes) => element("polyline", { points: points.map((p) => at(p).map((v) => v.toFixed(1)).join(",")).join(" "), ...attributes });
    const parts = (this.first ? this.first.ways : []).map((way) => line(way.map((p, k) => seen(view, p, k * this.first.step)), { class: "path first" }));
    // where an obstacle may be: as much farther as it may be off
    if (this.newest) for (const [name, { away, outlines }] of Object.entries(this.newest.obstacles)) {
      for (const outline of outlines[String(view.coordinates)] || []) {
        const points = outline.map((p) => at(p).map((v) => v.toFixed(1)).join(",")).join(" "), words = away ? `${name}, within ${metres(away)}` : name;
        const may = element("polygon", { class: "may-be", points, "stroke-width": 2 * away * scale });
        const middle = at([0, 1].map((k) => outline.reduce((sum, p) => sum + p[k], 0) / outline.length));
        parts.push(element("g", { class: "obstacle" }, [...(away ? [may] : []), element("polygon", { points }, [element("title", {}, [words])]), element("text", { class: "mid on", x: middle[0], y: middle[1] + 4 }, [name])]));
      }
    }
    Object.entries(this.past).forEach(([name, past], k) => {
      const { from, ahead } = this.newest.robots[name], now = past[past.length - 1], { step } = this.newest;
      if (!now) return;
      const here = at(seen(view, now.at, now.time));
      // boxes of places by their radius; over time there is no disk
      if (view.coordinates) for (const one of past) {
        const [cx, cy] = at(seen(view, one.at, one.time));
        parts.push(element("circle", { class: `known k${k % 6}`, cx, cy, r: Math.max(one.away * scale, 1.5) }));
      }
      parts.push(line(past.map((one) => seen(view, one.at, one.time)), { class: `line c${k % 6}` }));
      parts.push(line(ahead.map((p, i) => seen(view, p, from + i * step)), { class: "path ahead" }));
      parts.push(element("circle", { class: `robot k${k % 6}`, cx: here[0], cy: here[1], r: Math.max(5, view.coordinates ? this.scene.drawing.radius * scale : 0) }, [element("title", {}, [`${name}, within ${metres(now.away)}`])]));
    });
    return parts;
  }
}

const metres = (value) => (value === null ? "none" : `${+value.toPrecision(3)} m`);
// what holds from each time on until the next
const stairs = (list) => list.flatMap((one, k) => (k ? [[one[0], ...list[k - 1].slice(1)], one] : [one]));
