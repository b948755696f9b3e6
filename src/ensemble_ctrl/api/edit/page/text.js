// The problem file as text: what is typed goes to the server, what changes there is shown; errors are underlined.
const $ = (id) => document.getElementById(id);
const PAUSE = 250; // milliseconds after a key

export class TextPane {
  constructor(app) {
    this.app = app;
    this.area = $("text");
    this.under = $("under");
    this.revision = 0;
    this.timer = null;
    this.sending = null;
    this.area.oninput = () => {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.flush(), PAUSE);
      this.mark();
    };
    this.area.onscroll = () => this.scroll();
    this.area.onkeydown = (event) => {
      if (event.key !== "Tab" || event.shiftKey || event.ctrlKey) return;
      if (this.escaped) return; // Esc and then Tab leaves the text
      event.preventDefault();
      this.area.setRangeText("  ", this.area.selectionStart, this.area.selectionEnd, "end");
      this.area.oninput();
    };
    this.area.onkeyup = (event) => { this.escaped = event.key === "Escape"; };
  }
  // send what was typed; resolves once the server has it
  async flush() {
    clearTimeout(this.timer);
    this.timer = null;
    while (this.sending) await this.sending;
    const text = this.area.value;
    if (!this.app.state || text === this.shown) return;
    const before = this.shown;
    this.shown = text;
    this.sending = this.app.changes.send("/api/text", { text, revision: this.revision });
    const good = await this.sending;
    this.sending = null;
    if (!good) {
      this.shown = before;
      if (this.app.state.revision !== this.revision) this.take(this.app.state);
    }
  }
  show(state) {
    const typed = this.timer !== null || (this.shown !== undefined && this.area.value !== this.shown);
    if (state.text === this.area.value) {
      this.shown = state.text;
      this.revision = state.revision;
    } else if (!typed && !this.sending) this.take(state);
    this.errors = state.found;
    this.list(state.found);
    this.mark();
  }
  take(state) {
    const { selectionStart, selectionEnd, scrollTop, scrollLeft } = this.area;
    this.area.value = this.shown = state.text;
    this.revision = state.revision;
    this.area.setSelectionRange(selectionStart, selectionEnd);
    this.area.scrollTop = scrollTop;
    this.area.scrollLeft = scrollLeft;
    this.mark();
  }
  scroll() {
    this.under.scrollTop = this.area.scrollTop;
    this.under.scrollLeft = this.area.scrollLeft;
  }
  // the same text below, with waves where something is wrong and soft comments
  mark() {
    const lines = this.area.value.split("\n");
    const wrong = new Map();
    for (const one of this.errors || []) if (one.line) wrong.set(one.line - 1, [...(wrong.get(one.line - 1) || []), one]);
    const parts = [];
    lines.forEach((line, i) => {
      let from = 0;
      for (const one of wrong.get(i) || []) {
        const start = Math.min(Math.max(one.column - 1, from), line.length);
        const word = /^(?:"[^"]*"|[^\s,\]}#]+)/.exec(line.slice(start));
        const end = Math.max(start + (word ? word[0].length : 1), start + 1);
        parts.push(line.slice(from, start), wave(line.slice(start, end) || " ", one));
        from = end;
      }
      parts.push(line.slice(from), "\n");
    });
    this.under.replaceChildren(...parts);
    this.scroll();
  }
  list(found) {
    $("found").replaceChildren(...found.map((one) => {
      const item = document.createElement("li");
      const button = document.createElement("button");
      button.type = "button";
      item.className = one.severity;
      button.textContent = one.line ? `${one.line}:${one.column}` : one.severity;
      button.onclick = () => this.go(one);
      item.append(button, ` ${one.path ? `${one.path}: ` : ""}${one.message}`);
      if (one.hint) {
        const hint = document.createElement("span");
        hint.className = "note";
        hint.textContent = ` ${one.hint}`;
        item.append(hint);
      }
      return item;
    }));
  }
  go(one) {
    if (!one.line) return;
    const lines = this.area.value.split("\n");
    const place = lines.slice(0, one.line - 1).reduce((sum, line) => sum + line.length + 1, 0) + one.column - 1;
    this.area.focus();
    this.area.setSelectionRange(place, place);
  }
}

function wave(text, one) {
  const mark = document.createElement("u");
  mark.className = one.severity;
  mark.textContent = text;
  return mark;
}
