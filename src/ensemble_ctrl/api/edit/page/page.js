// What every page says above its map: notices, and whether the server answers.
const $ = (id) => document.getElementById(id);

export class Page {
  connection(text) {
    if (text) {
      this.notice(text, [], "connection");
      $("verdict").className = "verdict open";
      $("verdict").textContent = "Not connected";
    } else if ($("notice").dataset.kind === "connection") this.notice("");
  }
  notice(text, actions, kind) {
    const element = $("notice");
    if (!text && !kind && ["disk", "connection"].includes(element.dataset.kind)) return;
    element.replaceChildren(text);
    element.dataset.kind = kind || "";
    for (const [label, action] of actions || []) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = label;
      button.onclick = () => { this.notice("", [], "done"); action(); };
      element.append(" ", button);
    }
    element.hidden = !text;
  }
}
