// Time: the slider, and playing the plan; the map asks where everything is.
const $ = (id) => document.getElementById(id);
const SECONDS = 8; // the whole plan, whatever it takes in the field

export class Player {
  constructor(app) {
    this.app = app;
    this.share = 1;
    this.playing = false;
    this.last = null;
    $("play").onclick = () => (this.playing ? this.stop() : this.start());
    $("time").oninput = () => { this.stop(); this.to($("time").value / 1000); };
  }
  plan(drawing) { this.drawing = drawing; this.to(this.share); this.scale(drawing.scale); }
  // how long all plans that are shown take; each of them stays at its end
  of(drawings) { this.drawing = { duration: Math.max(...drawings.map((one) => one.duration)) }; this.to(this.share); }
  get time() { return this.drawing ? this.share * this.drawing.duration : 0; }

  // between which of a drawing's times it is, and how far
  place(drawing) {
    const { times } = drawing, t = this.time;
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    const share = (t - times[low]) / (times[high] - times[low] || 1);
    return [low, high, Math.min(1, Math.max(0, share))];
  }
  at(track, drawing) {
    const [low, high, share] = this.place(drawing);
    return [0, 1].map((k) => track[low][k] + share * (track[high][k] - track[low][k]));
  }
  to(share) {
    this.share = share;
    $("time").value = Math.round(1000 * share);
    const text = `${this.time.toFixed(2)} s`;
    $("clock").textContent = `t = ${text}`;
    $("time").setAttribute("aria-valuetext", text);
    document.querySelectorAll(".cursor").forEach((line) => {
      const x = +line.dataset.x0 + share * (line.dataset.x1 - line.dataset.x0);
      line.setAttribute("x1", x.toFixed(1));
      line.setAttribute("x2", x.toFixed(1));
    });
    this.app.map && this.app.map.move();
  }
  start() {
    if (!this.drawing) return;
    if (this.share >= 1) this.to(0);
    this.playing = true;
    this.last = null;
    $("play").textContent = "Pause";
    requestAnimationFrame((now) => this.tick(now));
  }
  stop() { this.playing = false; $("play").textContent = "Play"; }
  tick(now) {
    if (!this.playing) return;
    if (this.last !== null) this.to(Math.min(1, this.share + (now - this.last) / 1000 / SECONDS));
    this.last = now;
    if (this.share >= 1) this.stop(); else requestAnimationFrame((later) => this.tick(later));
  }
  scale(scale) {
    const element = $("scale");
    element.hidden = !scale;
    if (!scale) return;
    const bar = document.createElement("i");
    bar.style.background = `linear-gradient(90deg, ${scale.stops.join(", ")})`;
    const low = document.createElement("span"), high = document.createElement("span");
    low.textContent = `${scale.name} ${scale.ends[0]}`;
    high.textContent = scale.ends[1];
    element.replaceChildren(low, bar, high);
  }
}
