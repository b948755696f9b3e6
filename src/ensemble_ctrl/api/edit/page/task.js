// The task as pieces that one clicks: visit, stay, avoid, each in a window.
const WORDS = { visit: "Visit", stay: "Stay in", avoid: "Avoid", other: "Formula" };

export class Task {
  constructor(app, element) { this.app = app; this.element = element; }
  show(state) {
    if (this.element.contains(document.activeElement) && this.state && state.text === this.state.text) return;
    this.state = state;
    const { pieces, shapes, data } = state.map;
    const parts = [];
    if (pieces === null) {
      const words = document.createElement("p");
      words.textContent = "The task is no formula yet; mend it in the text, or start with a piece:";
      parts.push(words);
    }
    const list = document.createElement("ul");
    list.className = "pieces";
    (pieces || []).forEach((piece, i) => list.append(this.piece(piece, i, shapes)));
    const add = document.createElement("div");
    add.className = "add";
    for (const kind of ["visit", "stay", "avoid"]) add.append(this.adding(kind, shapes));
    const formula = document.createElement("p");
    formula.className = "note";
    formula.textContent = data && data.task ? `As a formula: ${data.task}` : "";
    parts.push(list, add, formula);
    this.element.replaceChildren(...parts);
  }
  piece(piece, i, shapes) {
    const item = document.createElement("li");
    item.className = piece.kind;
    const word = document.createElement("b");
    word.textContent = `${WORDS[piece.kind]} `;
    item.append(word);
    if (piece.kind === "other") {
      const text = field(piece.text, "formula", (value) => this.put(i, { ...piece, text: value }));
      text.classList.add("long");
      item.append(text);
    } else {
      item.append(this.places(piece, i, shapes), " ");
      const windowed = document.createElement("span");
      windowed.className = "window";
      if (piece.window) {
        windowed.append("from ", this.side(piece, i, 0), " to ", this.side(piece, i, 1), " s ");
        windowed.append(small("whole time", () => this.put(i, { ...piece, window: null })));
      } else {
        const whole = piece.kind === "visit" ? "at some time " : "all the time ";
        windowed.append(whole, small("in a window", () => this.put(i, { ...piece, window: ["0", "T"] })));
      }
      item.append(windowed);
    }
    const remove = small("×", () => this.save(this.pieces.filter((_, k) => k !== i)));
    remove.setAttribute("aria-label", `Remove: ${piece.text}`);
    remove.disabled = this.pieces.length < 2;
    item.append(remove);
    return item;
  }
  get pieces() { return this.state.map.pieces || []; }
  side(piece, i, k) {
    return field(piece.window[k], k ? "end of the window" : "begin of the window", (value) => {
      const window = [...piece.window];
      window[k] = value;
      this.put(i, { ...piece, window });
    });
  }
  places(piece, i, shapes) {
    const kinds = piece.kind === "avoid" ? ["obstacle", "region"] : ["region"];
    const names = [...new Set(shapes.filter((s) => kinds.includes(s.kind)).map((s) => s.name))];
    if (piece.kind === "avoid") names.unshift("obstacles");
    if (!names.includes(piece.place)) names.push(piece.place);
    const select = document.createElement("select");
    select.setAttribute("aria-label", "place");
    for (const name of names) select.append(new Option(name === "obstacles" ? "all obstacles" : name, name, false, name === piece.place));
    select.onchange = () => this.put(i, { ...piece, place: select.value });
    return select;
  }
  adding(kind, shapes) {
    const regions = shapes.filter((shape) => shape.kind === "region");
    const used = this.pieces.map((piece) => piece.place);
    const free = regions.find((shape) => !used.includes(shape.name)) || regions[0];
    const place = kind === "avoid" ? "obstacles" : free && free.name;
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `+ ${WORDS[kind]}`;
    button.disabled = !place;
    button.title = place ? "" : "draw a region first";
    button.onclick = () => this.save([...this.pieces, { kind, place, window: null }]);
    return button;
  }
  put(i, piece) { this.save(this.pieces.map((one, k) => (k === i ? piece : one))); }
  save(pieces) { this.app.edit([{ do: "task", pieces }]); }
}

function field(value, label, changed) {
  const input = document.createElement("input");
  input.value = value;
  input.setAttribute("aria-label", label);
  input.onchange = () => changed(input.value.trim());
  return input;
}
function small(text, action) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "small";
  button.textContent = text;
  button.onclick = action;
  return button;
}
