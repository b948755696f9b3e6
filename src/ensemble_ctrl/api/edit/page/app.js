// The page: what is edited and what is planned, and the parts that show it.
import { get, post } from "./api.js";
import { MapView } from "./map.js";
import { Page } from "./page.js";
import { Player } from "./player.js";
import { Settings } from "./settings.js";
import { Task } from "./task.js";
import { Tools } from "./tools.js";
import { TextPane } from "./text.js";
import { Proof } from "./proof.js";
import { Selected } from "./selected.js";

const $ = (id) => document.getElementById(id);

// One request for a change at a time; of changes that wait, a newer one of the same drag replaces the older.
class Changes {
  constructor(app) { this.app = app; this.waiting = []; this.busy = false; }
  send(path, body, key) {
    const last = this.waiting[this.waiting.length - 1];
    if (key && last && last.key === key) this.waiting.pop();
    return new Promise((done) => {
      this.waiting.push({ path, body, key, done });
      this.next();
    });
  }
  async next() {
    if (this.busy || !this.waiting.length) return;
    this.busy = true;
    const { path, body, done } = this.waiting.shift();
    try {
      this.app.shown(await post(path, body));
      this.app.notice("");
      done(true);
    } catch (error) {
      this.app.notice(error.message);
      done(false);
    }
    this.busy = false;
    this.next();
  }
}

export class App extends Page {
  constructor() {
    super();
    this.state = null;
    this.plan = null;      // the last plan that was drawn
    this.phase = "";
    this.suggestions = null;
    this.changes = new Changes(this);
    this.selection = null; // {kind, name, index}
    this.map = new MapView(this, $("map"), Tools);
    this.player = new Player(this);
    this.text = new TextPane(this);
    this.task = new Task(this, $("tab-task"));
    this.settings = new Settings(this, $("tab-settings"));
    this.proof = new Proof(this, $("tab-proof"));
    this.selected = new Selected(this, $("selected"));
    $("undo").onclick = () => this.changes.send("/api/step/undo");
    $("redo").onclick = () => this.changes.send("/api/step/redo");
    $("save").onclick = () => this.save();
    document.querySelectorAll("[role=tab]").forEach((tab) => {
      tab.onclick = () => this.tab(tab.dataset.tab);
      tab.onkeydown = (event) => this.tabKey(event, tab);
    });
    document.addEventListener("keydown", (event) => this.key(event));
    window.addEventListener("beforeunload", (event) => {
      if (this.state && this.state.dirty) event.preventDefault();
    });
    get("/api/schema").then((schema) => this.settings.describe(schema)).catch((error) => this.notice(error.message));
  }

  // changes of the file
  edit(edits, group, dragging) {
    const body = { edits, group, dragging: Boolean(dragging) };
    return this.changes.send("/api/edit", body, dragging ? group : null);
  }
  async save(force) {
    await this.text.flush();
    return this.changes.send("/api/save", { force: Boolean(force) });
  }

  // what the server says
  event(event) {
    if (event.kind === "state") this.shown(event);
    else if (event.kind === "plan") this.planned(event);
  }
  shown(state) {
    if (state.revision === undefined || (this.state && state.revision < this.state.revision)) return;
    this.state = state;
    $("file").textContent = state.file;
    document.title = `${state.dirty ? "• " : ""}${state.file}`;
    $("dirty").hidden = !state.dirty;
    $("undo").disabled = !state.undo;
    $("redo").disabled = !state.redo;
    $("save").disabled = !state.dirty && state.disk === "same";
    this.text.show(state);
    this.task.show(state);
    this.settings.show(state);
    this.map.draw();
    this.selected.show();
    this.disk(state);
    this.verdict();
  }
  planned(event) {
    this.phase = event.phase;
    this.revision = event.revision;
    if (event.phase === "planning") {
      this.suggestions = null;
      this.since = performance.now();
    }
    if (event.phase === "suggested") this.suggestions = event;
    if (event.phase === "failed") this.failure = event.why;
    if (event.phase === "planned") {
      this.failure = "";
      if (!this.plan) this.map.refit(); // show all of the first one
      this.plan = event;
      this.suggestions = null;
      this.player.plan(event.drawing);
      document.documentElement.dataset.planned = event.revision;
    }
    this.map.draw();
    this.verdict();
    if (event.phase === "planned" && event.drawing.proven && this.fresh) document.documentElement.dataset.drawn = performance.now();
    this.proof.show();
  }
  // starts that are not in the file as numbers of their own
  ends(view) { return { starts: view.starts.length > 1 && this.fresh && !this.state.map.starts.length ? view.starts : [], target: null }; }
  // what the map draws over the problem
  get drawings() { return this.plan ? [{ drawing: this.plan.drawing }] : []; }
  // whether the plan that is drawn is of the text as it is
  get fresh() { return this.plan && this.state && this.plan.revision === this.state.revision && this.state.valid && !this.map.ahead(); }

  verdict() {
    const element = $("verdict");
    const valid = Boolean(this.state && this.state.valid);
    const busy = valid && (this.phase === "planning" || this.phase === "suggesting");
    const seconds = Math.floor((performance.now() - (this.since || performance.now())) / 1000);
    let words = `Planning${seconds > 2 ? ` for ${seconds} s` : ""}`, kind = "open";
    clearTimeout(this.clock);
    if (busy && !this.fresh) this.clock = setTimeout(() => this.verdict(), 1000);
    const errors = this.state ? this.state.found.filter((one) => one.severity === "error") : [];
    if (this.state && !this.state.valid) {
      const first = errors[0];
      words = first ? `${first.line ? `Line ${first.line}: ` : ""}${first.message}` : "The text is no problem yet";
      kind = "bad";
    } else if (this.fresh) {
      words = this.plan.drawing.verdict;
      kind = this.plan.drawing.class;
    } else if (this.failure && !busy) {
      words = this.failure;
      kind = "bad";
    }
    element.textContent = words.charAt(0).toUpperCase() + words.slice(1);
    element.className = `verdict ${kind}`;
    element.classList.toggle("busy", busy);
    document.documentElement.dataset.phase = this.phase;
    document.documentElement.dataset.fresh = this.fresh ? "yes" : "no";
  }
  disk(state) {
    if (state.disk === "changed") {
      this.notice(`${state.file} was changed on disk.`, [
        ["Load that", () => this.changes.send("/api/step/reload")],
        ["Overwrite it with this", () => this.save(true)],
      ], "disk");
    } else if (state.disk === "missing") {
      this.notice(`${state.file} is not on disk any more. Save writes it again.`, [], "disk");
    } else if ($("notice").dataset.kind === "disk") this.notice("");
  }

  select(selection) {
    this.selection = selection;
    this.map.draw();
    this.selected.show();
    if (!this.suggestions) this.map.hint();
  }

  tab(name) {
    document.querySelectorAll("[role=tab]").forEach((tab) => {
      const shown = tab.dataset.tab === name;
      tab.setAttribute("aria-selected", shown);
      tab.tabIndex = shown ? 0 : -1;
      $(`tab-${tab.dataset.tab}`).hidden = !shown;
    });
    if (name === "settings") this.settings.show(this.state, true);
    if (name === "proof") this.proof.show();
    if (name === "text") this.text.mark();
  }
  tabKey(event, tab) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const tabs = [...document.querySelectorAll("[role=tab]")];
    const next = tabs[(tabs.indexOf(tab) + step + tabs.length) % tabs.length];
    this.tab(next.dataset.tab);
    next.focus();
    event.preventDefault();
    event.stopPropagation();
  }
  key(event) {
    const command = event.ctrlKey || event.metaKey;
    const letter = event.key.toLowerCase();
    if (command && letter === "s") { this.save(); event.preventDefault(); return; }
    const typing = event.target.closest("input:not([type=range]), textarea, select");
    if (typing && event.target.id !== "text") return;
    if (command && (letter === "z" || letter === "y")) {
      const redo = letter === "y" || event.shiftKey;
      event.preventDefault();
      this.text.flush().then(() => this.changes.send(redo ? "/api/step/redo" : "/api/step/undo"));
      return;
    }
    if (!typing && !command && !event.altKey) this.map.key(event);
  }
}
