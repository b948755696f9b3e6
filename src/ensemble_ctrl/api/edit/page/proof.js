// What is proven, in words and charts; what would help, as buttons.
export class Proof {
  constructor(app, element) { this.app = app; this.element = element; }
  show() {
    const { plan, suggestions, phase } = this.app;
    if (this.element.hidden && !this.element.dataset.shown) this.element.dataset.shown = "";
    const parts = [];
    if (phase === "suggesting") parts.push(note("Looking for a change that helps …"));
    if (suggestions) parts.push(this.helps(suggestions));
    if (plan) {
      const { drawing } = plan;
      parts.push(rows(drawing.rows));
      for (const [title, html] of Object.entries(drawing.cards)) {
        const heading = document.createElement("h2"), body = document.createElement("div");
        heading.textContent = title;
        body.innerHTML = html; // escaped by the server, which also allows no script but the page's own files
        parts.push(heading, body);
      }
      const how = plan.whole ? "Planned" : "Continued from the last plan";
      parts.push(note(`${how}, replayed and certified in ${plan.seconds.toFixed(2)} s.`));
    } else parts.push(note("There is no plan yet."));
    this.element.replaceChildren(...parts);
    this.element.classList.toggle("old", !this.app.fresh);
    this.app.player.to(this.app.player.share);
    this.hints(suggestions);
  }
  helps(found) {
    const box = document.createElement("div");
    box.className = "helps";
    const heading = document.createElement("h2");
    heading.textContent = found.helps.length ? "It works with" : "No small change was found that helps";
    box.append(heading);
    for (const one of found.helps) box.append(this.button(one));
    if (found.failed.length) box.append(note(`No plan even with ${found.failed.join("; ")}.`));
    if (found.limited) box.append(note("The time for this was up: other changes were not tried."));
    return box;
  }
  button(one) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "help";
    button.textContent = one.change;
    button.disabled = !one.set.length;
    button.title = one.set.join("  ");
    button.onclick = () => this.app.edit(one.set.map(change));
    return button;
  }
  // the same buttons beside the map, where one looks
  hints(found) {
    const place = document.getElementById("hint");
    place.replaceChildren();
    if (!found) return this.app.map.hint();
    if (found.helps.length) {
      place.append("It works with ");
      for (const one of found.helps) place.append(this.button(one), " ");
    } else place.append("No small change was found that helps; see Proof.");
  }
}

// KEY=VALUE as a change of the file
function change(text) {
  const at = text.indexOf("=");
  const path = text.slice(0, at).match(/[^.[\]]+/g).map((key) => (/^\d+$/.test(key) ? +key : key));
  const value = text.slice(at + 1).trim();
  return /^(null|~|)$/.test(value) ? { do: "remove", path } : { do: "text", path, value };
}
function note(text) {
  const element = document.createElement("p");
  element.className = "note";
  element.textContent = text;
  return element;
}
function rows(pairs) {
  const list = document.createElement("dl");
  for (const [label, text] of pairs) {
    const term = document.createElement("dt"), words = document.createElement("dd");
    term.textContent = label;
    words.textContent = text;
    list.append(term, words);
  }
  return list;
}
