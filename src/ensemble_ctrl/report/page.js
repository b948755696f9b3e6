"use strict";
(function () {
  const motion = JSON.parse(document.getElementById("motion").textContent);
  const slider = document.getElementById("time");
  if (!slider) return;
  const button = document.getElementById("play");
  const clock = document.getElementById("clock");
  const members = document.querySelectorAll(".member");
  const moving = document.querySelectorAll("[data-moves]");
  const cursors = document.querySelectorAll(".cursor");
  let time = motion.duration, last = null, playing = false;

  function place(t) {
    const times = motion.times;
    let k = 0, high = times.length - 1;
    while (high - k > 1) {
      const middle = (k + high) >> 1;
      if (times[middle] <= t) k = middle; else high = middle;
    }
    const share = Math.min(1, Math.max(0, (t - times[k]) / (times[k + 1] - times[k])));
    const between = function (track) {
      const a = track[k], b = track[k + 1];
      return [(a[0] + share * (b[0] - a[0])) / 10, (a[1] + share * (b[1] - a[1])) / 10];
    };
    members.forEach(function (dot, i) {
      const p = between(motion.members[i]);
      if (motion.headings) {
        const track = motion.headings[i], angle = (track[k] + share * (track[k + 1] - track[k])) / 10;
        const where = p[0].toFixed(1) + " " + p[1].toFixed(1);
        dot.setAttribute("transform", "translate(" + where + ") rotate(" + angle.toFixed(1) + ")");
        return;
      }
      dot.setAttribute("cx", p[0].toFixed(1));
      dot.setAttribute("cy", p[1].toFixed(1));
    });
    moving.forEach(function (group) {
      const p = between(motion.obstacles[group.dataset.moves]);
      group.setAttribute("transform", "translate(" + p[0].toFixed(1) + " " + p[1].toFixed(1) + ")");
    });
    const done = motion.duration > 0 ? t / motion.duration : 0;
    cursors.forEach(function (line) {
      const x = +line.dataset.x0 + done * (line.dataset.x1 - line.dataset.x0);
      line.setAttribute("x1", x.toFixed(1));
      line.setAttribute("x2", x.toFixed(1));
    });
    clock.textContent = "t = " + t.toFixed(2) + " s";
    slider.setAttribute("aria-valuetext", t.toFixed(2) + " s");
  }

  function show(t) {
    time = t;
    slider.value = 1000 * t / motion.duration;
    place(t);
  }

  function tick(now) {
    if (!playing) return;
    if (last !== null) {
      // the whole plan in 8 s, whatever it takes in the field
      show(Math.min(motion.duration, time + (now - last) / 8000 * motion.duration));
    }
    last = now;
    if (time >= motion.duration) stop(); else requestAnimationFrame(tick);
  }

  function stop() {
    playing = false;
    button.textContent = "Play";
  }

  button.addEventListener("click", function () {
    if (playing) return stop();
    if (time >= motion.duration) show(0);
    playing = true;
    last = null;
    button.textContent = "Pause";
    requestAnimationFrame(tick);
  });
  slider.addEventListener("input", function () {
    stop();
    time = slider.value / 1000 * motion.duration;
    place(time);
  });
  show(motion.duration);
}());
