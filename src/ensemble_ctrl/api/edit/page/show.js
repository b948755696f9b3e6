// What is looked at and not changed: saved plans over each other, a search, or a loop.
import { Loop } from "./loop.js";
import { MapView } from "./map.js";
import { Overlay } from "./overlay.js";
import { Page } from "./page.js";
import { Player } from "./player.js";
import { Search } from "./search.js";

const $ = (id) => document.getElementById(id);
const PARTS = { view: Overlay, search: Search, loop: Loop };
const HINT = "Drag the ground to move the map, turn the wheel to come closer.";

// The map's tools where there are none.
class Looking {
  constructor() { this.tool = "select"; this.snap = 0; }
  hint() { return HINT; }
  key() {}
  choose() {}
}

export class Show extends Page {
  constructor() {
    super();
    this.readonly = true;
    this.fresh = true;
    this.selection = null;
    this.state = null;
    this.part = null;
    this.map = new MapView(this, $("map"), Looking);
    this.player = new Player(this);
    document.addEventListener("keydown", (event) => {
      if (["0", "+", "-"].includes(event.key) && !event.ctrlKey && !event.metaKey) this.map.key(event);
    });
  }
  get drawings() { return this.part ? this.part.drawings : []; }
  live(view, at, scale) { return this.part.live ? this.part.live(view, at, scale) : []; }
  points(view) { return this.part && this.part.points ? this.part.points(view) : []; }
  // the map from above has them as the problem's own
  ends(view, index) { return { starts: index || view.starts.length > 1 ? view.starts : [], target: index ? view.target : null }; }
  // obstacles that are drawn otherwise
  get covered() { return this.part && this.part.covered; }
  select() {}

  event(event) {
    if (event.kind === "state") this.begin(event);
    else if (event.kind === "end") this.connection("The command has ended; what is shown stays.");
    else if (this.part) this.part.event(event);
  }
  // a stream that was broken off begins with the state again
  begin(state) {
    this.state = state;
    $("file").textContent = state.file;
    document.title = state.file;
    this.part = new PARTS[state.mode](this, $("shown"), state);
    this.map.refit();
    this.map.draw();
    this.map.hint();
  }
  verdict(words, kind, busy) {
    const line = $("verdict");
    line.textContent = words.charAt(0).toUpperCase() + words.slice(1);
    line.className = `verdict ${kind}`;
    line.classList.toggle("busy", Boolean(busy));
  }
}
