import { puts } from "./geometry.js";

// What a press on the map does: select, or draw a shape, or put the start or the target there.
const TOOLS = [
  ["select", "Select", "v"], ["box", "Box", "b"], ["polygon", "Polygon", "p"], ["disc", "Disc", "d"],
  ["waypoint", "Way-point", "w"], ["start", "Start", "s"], ["target", "Target", "t"],
];
const HINTS = {
  select: "Drag shapes, the start and the target; drag the ground to move the map, turn the wheel to come closer.",
  box: "Drag from one corner to the other.",
  polygon: "Click the corners; Enter, or a click on the first one, closes it.",
  disc: "Drag from the centre to the rim.",
  waypoint: "Click where the fleet has to pass: a region with a visit in the task.",
  start: "Click where the fleet starts; its arrow turns it.",
  target: "Click where the fleet should end.",
};
const SNAPS = [["off", 0], ["1 cm", 0.01], ["5 cm", 0.05], ["10 cm", 0.1], ["50 cm", 0.5], ["1 m", 1]];

export class Tools {
  constructor(app, map) {
    this.app = app;
    this.map = map;
    this.tool = "select";
    this.kind = "obstacle";
    const place = document.getElementById("tools");
    this.buttons = TOOLS.map(([name, label, letter]) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = label;
      button.dataset.tool = name;
      button.title = `${HINTS[name]} (${letter})`;
      button.setAttribute("aria-pressed", name === "select");
      button.onclick = () => this.choose(name);
      return button;
    });
    const kind = choice("kind", "as", [["obstacle", "obstacle"], ["region", "region"], ["slow zone", "zone"], ["terrain", "patch"]]);
    kind.lastChild.onchange = (event) => { this.kind = event.target.value; };
    const snap = choice("snap", "snap", SNAPS);
    this.snapped = snap.lastChild;
    this.snapped.value = "0.05";
    const file = document.createElement("input");
    file.type = "file";
    file.accept = ".geojson,.json,.wkt";
    file.hidden = true;
    file.onchange = () => { this.bring(file.files[0]); file.value = ""; };
    const bring = document.createElement("button");
    bring.type = "button";
    bring.textContent = "Import …";
    bring.title = "A map as GeoJSON or WKT; or drop the file on the page";
    bring.onclick = () => file.click();
    place.append(...this.buttons, kind, snap, bring, file);
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("drop", (event) => {
      if (!event.dataTransfer.files.length) return;
      event.preventDefault();
      this.bring(event.dataTransfer.files[0]);
    });
  }
  get snap() { return +this.snapped.value; }
  choose(name) {
    this.tool = name;
    this.map.sketch = null;
    this.buttons.forEach((button) => button.setAttribute("aria-pressed", button.dataset.tool === name));
    this.map.svg.dataset.tool = name;
    this.map.draw();
    this.map.hint();
  }
  key(letter) {
    const found = TOOLS.find(([, , own]) => own === letter);
    if (found) this.choose(found[0]);
  }
  hint(shape) {
    if (this.tool === "select" && shape && shape.form === "polygon") return "Drag corners; a small dot makes a new one; Alt and a click takes a corner out.";
    return HINTS[this.tool];
  }
  async bring(file) {
    const content = await file.text();
    this.app.changes.send("/api/import", { name: file.name, content });
  }
  // a new area with what the task needs to know of it, as one change
  async add(shape, kind, visit) {
    const { shapes, pieces } = this.app.state.map;
    const names = new Set(shapes.map((one) => one.name));
    const letter = { obstacle: "o", zone: "z", patch: "t" }[kind] || (visit ? "w" : "r");
    let k = 1;
    while (names.has(letter + k)) k++;
    const name = letter + k, section = { obstacle: "obstacles", zone: "zones", patch: "terrain" }[kind] || "regions";
    const more = { zone: { v: "0.5 m/s" }, patch: this.ground() }[kind];
    if (kind === "patch" && !more) return this.refused("Terrain is where a parameter has another range: give the fleet a parameter with a range first.");
    const edits = [{ do: "put", path: [section, name], value: { ...shape, ...more } }];
    const tasked = pieces || [];
    if (kind === "region") edits.push({ do: "task", pieces: [...tasked, { kind: "visit", place: name, window: null }] });
    else if (kind === "obstacle" && !tasked.some((piece) => piece.kind !== "visit" && piece.kind !== "stay") && tasked.length) {
      edits.push({ do: "task", pieces: [...tasked, { kind: "avoid", place: "obstacles", window: null }] });
    }
    if (kind === "region" && shapes.some((one) => one.kind === "obstacle") && !tasked.length) {
      edits[1].pieces.push({ kind: "avoid", place: "obstacles", window: null });
    }
    if (pieces === null && this.app.state.map.data.task) edits.length = 1; // a formula that can't be read stays as it is
    this.choose("select");
    if (await this.app.edit(edits)) {
      const index = this.app.state.map.shapes.findIndex((one) => one.name === name);
      this.app.select({ kind, name, index });
    }
  }
  // a parameter that may be otherwise on some ground, with the range that it has elsewhere
  ground() {
    const { fleet } = this.app.state.map.data, ranges = Object.entries((fleet || {}).parameters || {}).filter(([, one]) => Array.isArray(one.range));
    const [name, { range }] = ranges.find(([one]) => one.includes("traction")) || ranges[0] || ["", {}];
    return range ? { [name]: range } : null;
  }
  refused(words) {
    this.app.notice(words);
    this.choose("select");
  }
  putStart(point) {
    const data = this.app.state.map.data, own = this.app.state.map.start;
    const place = own ? [...point, ...own.at.slice(2)] : point;
    const edits = own ? puts(own, place)
      : [{ do: "put", path: ["fleet"], value: { model: "unicycle", ...data.fleet, start: { position: place, heading: "0 deg" } } }];
    if (!data.horizon) edits.push({ do: "put", path: ["horizon"], value: { duration: "10 s" } });
    this.app.edit(edits);
    this.choose("select");
    this.app.select({ kind: "start", name: "", index: 0 });
  }
  putTarget(point) {
    const own = this.app.state.map.target, terminal = (this.app.state.map.data.objective || {}).terminal;
    if (terminal && !own) return this.app.notice("The target is a formation or a distribution: change it in the text.");
    const value = own ? [...point, ...own.at.slice(2)] : point;
    this.app.edit([{ do: "put", path: ["objective", "terminal", "target"], value }]);
    this.choose("select");
    this.app.select({ kind: "target", name: "", index: 0 });
  }
}

function choice(id, text, options) {
  const label = document.createElement("label"), select = document.createElement("select");
  label.textContent = `${text} `;
  select.id = id;
  for (const [name, value] of options) select.append(new Option(name, value));
  label.append(select);
  return label;
}
