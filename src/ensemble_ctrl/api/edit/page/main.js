// Begins what the server shows: a file that is edited, or plans, a search or a loop that are looked at.
import { listen } from "./api.js";
import { App } from "./app.js";
import { Page } from "./page.js";
import { Show } from "./show.js";

const nothing = new Page();

listen((event) => {
  if (!window.editor) {
    document.documentElement.dataset.mode = event.mode;
    window.editor = event.mode === "edit" ? new App() : new Show();
  }
  window.editor.event(event);
}, (text) => (window.editor || nothing).connection(text));
