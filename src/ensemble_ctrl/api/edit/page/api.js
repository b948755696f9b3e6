// Requests to the editor's server; the token is in the address behind the #, which no browser sends anywhere.
const TOKEN = new URLSearchParams(location.hash.slice(1)).get("token") || "";

async function request(path, body) {
  const headers = { "X-Edit-Token": TOKEN };
  const given = body === undefined ? { headers } : { method: "POST", headers, body: JSON.stringify(body) };
  const answer = await fetch(path, given);
  const text = await answer.text();
  let data = {};
  try { data = JSON.parse(text); } catch { data = { error: text }; }
  if (!answer.ok) throw new Error(data.error || answer.statusText);
  return data;
}

export const get = (path) => request(path);
export const post = (path, body) => request(path, body || {});

// The stream of events, begun again whenever it breaks off; `changed` is told of each and of the connection.
// A page that is left ends it at once: a browser keeps such a page for a while, and it would count as open.
export async function listen(changed, connection) {
  let left = new AbortController(), shown = null;
  window.addEventListener("pagehide", () => {
    shown = new Promise((back) => window.addEventListener("pageshow", back, { once: true }));
    left.abort();
    left = new AbortController();
  });
  for (;;) {
    await shown;
    try {
      const answer = await fetch("/api/events", { headers: { "X-Edit-Token": TOKEN }, signal: left.signal });
      if (!answer.ok) throw new Error(await answer.text());
      connection("");
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      let waiting = "";
      for (;;) {
        const { value, done } = await reader.read();
        if (done) break;
        waiting += value;
        const parts = waiting.split("\n\n");
        waiting = parts.pop();
        for (const part of parts) {
          if (part.startsWith("data: ")) changed(JSON.parse(part.slice(6)));
        }
      }
      connection("The editor has ended. Start it again with the command.");
    } catch (error) {
      if (error.name === "AbortError") continue;
      connection(error instanceof TypeError ? "The editor does not answer. Is the command still running?" : error.message);
    }
    await new Promise((done) => setTimeout(done, 1000));
  }
}
