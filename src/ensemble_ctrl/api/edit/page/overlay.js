// Saved plans over each other: whose line is which, and what differs.
import { element } from "./surface.js";
import { html, table } from "./parts.js";

// each plan has a colour and a kind of line, for those who tell colours badly
const DASHES = ["", "7 3", "2 2", "8 2 2 2", "11 4", "4 1"];

export class Overlay {
  constructor(app, place, state) {
    this.app = app;
    this.plans = state.plans.map((plan, k) => ({ ...plan, colour: `var(--c${k})`, dash: DASHES[k], shown: true }));
    const all = html("input", { type: "checkbox" });
    const rows = table(state.table.names, state.table.rows, true);
    all.onchange = () => rows.classList.toggle("only", all.checked);
    place.replaceChildren(
      html("h2", { textContent: "Plans" }), html("ul", { className: "plans" }, this.plans.map((plan) => this.row(plan))),
      html("h2", { textContent: "What differs" }), html("label", { className: "note" }, [all, " only what differs"]), rows);
    this.verdict();
    queueMicrotask(() => this.changed());
  }
  get drawings() { return this.plans.filter((plan) => plan.shown); }
  row(plan) {
    const box = html("input", { type: "checkbox", checked: true });
    box.onchange = () => { plan.shown = box.checked; this.changed(); };
    const line = element("svg", { viewBox: "0 0 34 12", class: "swatch", "aria-hidden": "true" }, [
      element("line", { x1: 1, x2: 33, y1: 6, y2: 6, stroke: plan.colour, "stroke-width": 3, "stroke-dasharray": plan.dash }),
    ]);
    const words = html("small", { textContent: plan.drawing.verdict, className: plan.drawing.class });
    return html("li", {}, [html("label", {}, [box, " ", line, " ", html("b", { textContent: plan.name })]), words]);
  }
  changed() {
    const drawings = this.drawings.map((plan) => plan.drawing);
    this.app.map.draw();
    if (drawings.length) this.app.player.of(drawings);
  }
  verdict() {
    const good = this.plans.filter((plan) => plan.drawing.proven).length, count = this.plans.length;
    this.app.verdict(`${good} of ${count} plan${count === 1 ? "" : "s"} proven for every member`, good === count ? "good" : good ? "open" : "bad");
  }
  own(plan, view) { return plan.drawing.views.find((one) => one.axes[1] === view.axes[1]).own; }
  points(view) { return this.plans.flatMap((plan) => this.own(plan, view).flatMap((area) => area.corners)); }
  // what stands on the map of one plan only, in its colour
  live(view, at) {
    return this.drawings.flatMap((plan) => this.own(plan, view).flatMap((area) => {
      const corners = area.corners.map(at), middle = [0, 1].map((i) => corners.reduce((sum, p) => sum + p[i], 0) / corners.length);
      return [
        element("polygon", { class: "own", stroke: plan.colour, "stroke-dasharray": plan.dash, points: corners.map((p) => p.map((v) => v.toFixed(1)).join(",")).join(" ") },
          [element("title", {}, [`${area.name}, in ${plan.name}`])]),
        element("text", { class: "mid own-name", x: middle[0], y: middle[1] + 4 }, [area.name]),
      ];
    }));
  }
}
