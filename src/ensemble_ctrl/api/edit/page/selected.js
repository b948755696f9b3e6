// The shape that is selected, with its numbers: typed coordinates, its name, and out with it.
const FORMS = ["box", "polygon", "disc", "areas", "halfspaces", "wkt", "file", "feature", "tolerance", "unknown"];

export class Selected {
  constructor(app, element) {
    this.app = app;
    this.element = element;
    element.onsubmit = (event) => event.preventDefault();
  }
  show() {
    const shape = this.app.map.selectedShape();
    this.element.hidden = !shape;
    const key = shape ? JSON.stringify(shape) : "";
    if (key === this.key) return;
    const focus = this.element.contains(document.activeElement) ? document.activeElement.name : "";
    this.key = key;
    if (!shape) return;
    const parts = [];
    const title = document.createElement("b");
    title.textContent = { start: "Start", target: "Target", obstacle: "Obstacle", region: "Region", zone: "Zone", patch: "Terrain", member: "Start of members" }[shape.kind];
    parts.push(title);
    if (shape.kind === "member") parts.push(shape.name);
    else if (shape.name) parts.push(this.field("name", "name", shape.name, (value) => this.rename(shape, value)));
    if (shape.form === "fixed") {
      const words = document.createElement("span");
      words.className = "note";
      words.textContent = "from half-planes, WKT or a file: change it in the text";
      parts.push(words);
    } else parts.push(...this.numbers(shape));
    parts.push(...this.values(shape));
    if (shape.kind !== "start") {
      const remove = document.createElement("button");
      remove.type = "button";
      remove.textContent = "Delete";
      remove.title = "Delete (Del)";
      remove.onclick = () => this.app.map.remove();
      parts.push(remove);
    }
    this.element.replaceChildren(...parts);
    if (focus) this.element.elements[focus]?.focus();
  }
  // what a zone or a patch has besides its form: limits and ranges
  values(shape) {
    const section = { zone: "zones", patch: "terrain" }[shape.kind];
    if (!section) return [];
    const given = Object.entries(this.app.state.map.data[section][shape.name]).filter(([name]) => !FORMS.includes(name));
    const shown = (value) => (Array.isArray(value) ? `[${value.join(", ")}]` : String(value));
    return given.map(([name, value]) => this.field(`value ${name}`, name, shown(value), (text) => this.app.edit([{ do: "text", path: [section, shape.name, name], value: text }])));
  }
  numbers(shape) {
    const put = (path) => (value) => this.app.edit([{ do: "text", path, value }]);
    if (shape.kind === "member") {
      return shape.at.map((value, k) => this.field("xyz"[k], `${"xyz"[k]} from the start [m]`, +(value - shape.by[k]).toFixed(6), put([...shape.path, k])));
    }
    if (shape.kind === "start" || shape.kind === "target") {
      const fields = shape.at.map((value, k) => this.field("xyz"[k], `${"xyz"[k]} [m]`, value, put(shape.paths ? shape.paths[k] : [...shape.path, k])));
      if (shape.kind === "start" && shape.heading !== null) {
        const degrees = +(shape.heading * 180 / Math.PI).toFixed(4);
        fields.push(this.field("heading", "heading [deg]", degrees, (value) => this.app.map.turn(+value)));
      }
      return fields;
    }
    if (shape.form === "box") {
      return shape.points.flatMap((side, k) => side.map((value, end) =>
        this.field(`${"xyz"[k]}${end}`, `${"xyz"[k]} ${end ? "to" : "from"} [m]`, value, put([...shape.path, k, end]))));
    }
    if (shape.form === "disc") {
      const center = shape.points[0].map((value, k) => this.field("xy"[k], `${"xy"[k]} [m]`, value, put([...shape.path, "center", k])));
      return [...center, this.field("radius", "radius [m]", shape.radius, put([...shape.path, "radius"]))];
    }
    return shape.points.flatMap((corner, i) => corner.map((value, k) =>
      this.field(`c${i}${k}`, `${"xy"[k]}${i + 1} [m]`, value, put([...shape.path, i, k]))));
  }
  async rename(shape, name) {
    if (await this.app.edit([{ do: "rename", path: shape.entry.slice(0, 2), name }])) {
      this.app.select({ kind: shape.kind, name, index: this.app.selection.index });
    } else { this.key = null; this.show(); }
  }
  field(name, text, value, changed) {
    const label = document.createElement("label"), input = document.createElement("input");
    label.textContent = `${text} `;
    input.name = name;
    input.value = value;
    input.size = name === "name" ? 10 : 5;
    input.onchange = () => changed(input.value.trim());
    label.append(input);
    return label;
  }
}
