"use strict";
// Where a space is looked at from: so that all of it is in sight, and turned by keys too.
window.camera = (function () {
  const HALF_ANGLE = Math.tan(Math.PI / 8); // plotly sees 45 degrees from top to bottom
  const FILLED = 0.84; // the rest is for the numbers along the axes
  const STEP = Math.PI / 24, CLOSER = 0.88;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const list = (v) => [v.x, v.y, v.z], point = ([x, y, z]) => ({ x, y, z });
  const unit = (v) => v.map((c) => c / Math.hypot(...v));

  // Edges of the box of the axes, true to scale and as large as the eye sees whole.
  function ratio(ranges, view, place) {
    const edges = ranges.map(([low, high]) => Math.max(high - low, 1e-6)), eye = list(view.eye);
    const forward = unit(eye.map((c) => -c)), right = unit(cross(forward, list(view.up))), up = cross(right, forward);
    const filled = place.clientWidth < 560 ? 0.7 : FILLED, wide = HALF_ANGLE * (place.clientWidth / Math.max(place.clientHeight, 1));
    const corners = Array.from({ length: 8 }, (_, k) => edges.map((edge, a) => (k >> a & 1 ? 0.5 : -0.5) * edge));
    const fits = (size) => corners.every((corner) => {
      const p = corner.map((c) => c * size), depth = Math.hypot(...eye) + dot(p, forward);
      return depth > 0.1 && Math.abs(dot(p, right)) < filled * depth * wide && Math.abs(dot(p, up)) < FILLED * depth * HALF_ANGLE;
    });
    let low = 0, high = 4 / Math.max(...edges);
    for (let i = 0; i < 30; i++) {
      const middle = (low + high) / 2;
      if (fits(middle)) low = middle;
      else high = middle;
    }
    return point(edges.map((edge) => edge * low));
  }
  function about(axis, angle, v) { // Rodrigues
    const c = Math.cos(angle), along = (1 - c) * dot(axis, v), aside = cross(axis, v);
    return v.map((x, i) => c * x + Math.sin(angle) * aside[i] + along * axis[i]);
  }
  function moved(view, key) {
    const centre = list(view.center), up = unit(list(view.up));
    let away = list(view.eye).map((c, i) => c - centre[i]);
    const right = unit(cross(away, up));
    if (key === "ArrowLeft" || key === "ArrowRight") away = about(up, key === "ArrowLeft" ? STEP : -STEP, away);
    else if (key === "ArrowUp" || key === "ArrowDown") {
      const turned = about(right, key === "ArrowUp" ? STEP : -STEP, away);
      if (Math.abs(dot(unit(turned), up)) < 0.99) away = turned; // not over the pole
    } else if (key === "+" || key === "=") away = away.map((c) => c * CLOSER);
    else if (key === "-") away = away.map((c) => c / CLOSER);
    else return null;
    return { ...view, up: point(up), eye: point(away.map((c, i) => c + centre[i])) };
  }
  // Arrows turn, plus and minus come closer and go away, 0 goes back; home: where it was at first.
  function keys(place, home) {
    place.addEventListener("keydown", (event) => {
      const drawn = place._fullLayout && place._fullLayout.scene;
      if (!drawn || event.ctrlKey || event.altKey || event.metaKey) return;
      const now = drawn._scene.getCamera();
      const next = event.key === "0" ? { ...now, ...home, center: { x: 0, y: 0, z: 0 } } : moved(now, event.key);
      if (!next) return;
      event.preventDefault();
      window.Plotly.relayout(place, { "scene.camera": next });
    });
  }
  return { ratio, keys };
})();
