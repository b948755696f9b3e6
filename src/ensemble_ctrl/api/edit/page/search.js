// A search that goes on: its phases and iterations, the candidates on the map, and at last the plan.
import { element } from "./surface.js";
import { chart, html, seen, table } from "./parts.js";

const MOST = 400; // iterations in the chart
const DASHES = { "at work": "3 3", coarse: "3 3", failed: "2 6" };

export class Search {
  constructor(app, place, state) {
    this.app = app;
    this.place = place;
    this.scene = { drawing: state.scene };
    this.phases = [];
    this.iterations = [];
    this.found = [];
    this.plan = null;
    this.wanted = false;
    this.show();
    queueMicrotask(() => this.app.player.of([this.drawings[0].drawing]));
  }
  get drawings() { return [this.plan && this.plan.drawing ? { drawing: this.plan.drawing } : this.scene]; }
  event(event) {
    if (event.kind === "phase") this.phases.push(event);
    else if (event.kind === "iteration") {
      this.iterations.push(event);
      if (this.iterations.length > MOST) this.iterations.shift();
    } else if (event.kind === "candidates") this.found = event.found;
    else if (event.kind === "plan") {
      this.plan = event;
      if (event.drawing) {
        this.app.map.refit();
        this.app.player.plan(event.drawing);
      }
    } else if (event.kind === "done") this.done = true;
    if (event.kind !== "iteration") this.app.map.draw();
    this.show();
  }
  // at most once a frame
  show() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => { this.wanted = false; this.drawn(); });
  }
  drawn() {
    this.verdict();
    const last = this.phases[this.phases.length - 1], since = last ? ` since ${last.seconds.toFixed(1)} s` : "";
    const candidates = this.found.map((one, k) => ({ label: `${k + 1}`, cells: [this.plan && one.outcome === "at work" ? "tried" : one.outcome, one.cost === null ? "" : one.cost.toPrecision(4), one.length ? `${one.length.toFixed(2)} m` : "", one.kind, one.name] }));
    const parts = [html("h2", { textContent: "Search" }), html("p", { className: "note", textContent: this.phases.map((one) => one.phase).join(" → ") + (this.plan ? "" : since) })];
    const good = this.iterations.filter((one) => one.violation !== null);
    if (good.length > 1) {
      parts.push(chart("Largest violation of a constraint, over seconds", { log: true, lines: [{ points: good.map((one) => [one.seconds, Math.max(one.violation, 1e-9)]) }] }));
      parts.push(chart("Cost, over seconds", { lines: [{ points: good.filter((one) => one.cost !== null).map((one) => [one.seconds, one.cost]) }] }));
    }
    if (candidates.length) parts.push(html("h2", { textContent: "Candidates" }), table(["outcome", "cost", "length", "from", "sides"], candidates));
    this.place.replaceChildren(...parts);
  }
  verdict() {
    const last = this.iterations[this.iterations.length - 1], phase = this.phases[this.phases.length - 1];
    if (this.plan) return this.app.verdict(this.plan.verdict, this.plan.class, false);
    if (this.done) return this.app.verdict("the search ended without a plan", "bad", false);
    const how = last && phase && last.seconds >= phase.seconds && last.violation !== null ? `: iteration ${last.count}, violation ${last.violation.toExponential(1)}` : "";
    return this.app.verdict(`${phase ? phase.phase : "starting"}${how}`, "open", true);
  }
  // candidates on the map: the one kept is bold
  live(view, at) {
    if (!view.coordinates) return [];
    return this.found.filter((one) => one.corners.length > 1).map((one, k) => element("polyline", {
      class: `candidate c${k % 6} ${one.outcome.replace(" ", "-")}`, "stroke-dasharray": DASHES[one.outcome] || "",
      points: one.corners.map((p) => at(seen(view, p, 0)).map((v) => v.toFixed(1)).join(",")).join(" "),
    }, [element("title", {}, [`${one.name}: ${one.outcome}`])]));
  }
}
