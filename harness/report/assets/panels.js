"use strict";
// Beside the pair: the Gauss spheres of both views, the cloud of shifts, and the list of all trials.
window.panels = (function () {
  const $ = (id) => document.getElementById(id);
  const { load, numbers } = window.report;
  const draw = window.traces;
  const config = { responsive: true, displaylogo: false };
  const CAMERA = { up: { x: 1, y: 0, z: 0 }, eye: { x: 0.5, y: -0.4, z: -1.45 } };
  const SHIFTS_CAMERA = { up: { x: 1, y: 0, z: 0 }, eye: { x: 0.7, y: -0.9, z: -1.5 } };
  let now = null;

  function globe(scene) {
    const xyz = [], turn = Array.from({ length: 61 }, (_, i) => (2 * Math.PI * i) / 60);
    for (const deg of [30, 60, 90, 120, 150]) {
      const r = Math.sin((deg * Math.PI) / 180), z = -Math.cos((deg * Math.PI) / 180);
      for (const t of turn) xyz.push(r * Math.cos(t), r * Math.sin(t), z);
      xyz.push(NaN, NaN, NaN);
    }
    for (const deg of [0, 30, 60, 90, 120, 150]) {
      const a = (deg * Math.PI) / 180;
      for (const t of turn) xyz.push(Math.sin(t) * Math.cos(a), Math.sin(t) * Math.sin(a), -Math.cos(t));
      xyz.push(NaN, NaN, NaN);
    }
    return { ...draw.lines(draw.moved(draw.IDENTITY, xyz), { color: "#d5dbe0", width: 1.5 }, "globe"), scene };
  }
  function normals(role, scene, T, largest) {
    const { palette } = draw.colours(), sphere = now.layers[role].sphere;
    const [x, y, z] = draw.moved(T, numbers(sphere.direction));
    return {
      type: "scatter3d", mode: "markers", x, y, z, scene, showlegend: false,
      marker: { size: sphere.area_cm2.map((area) => Math.max(5, 34 * Math.sqrt(area / largest))), opacity: 1,
        color: sphere.colour.map((place) => (place < 0 ? draw.GREY : palette[place])), line: { width: 1, color: "#222" } },
      text: sphere.area_cm2.map((area, i) => `${role}, normal ${i + 1}: ${area} cm²`), hoverinfo: "text",
    };
  }
  let turning = false;
  function spheres() {
    const has = now.layers.target.sphere && now.layers.source.sphere;
    $("spheres-part").hidden = !has;
    if (!has) return;
    const pose = now.poses.estimate, turned = $("turned");
    turned.disabled = !pose;
    const T = pose && turned.checked ? pose.map((row) => [...row.slice(0, 3), 0]) : draw.IDENTITY;
    const largest = Math.max(...now.layers.target.sphere.area_cm2, ...now.layers.source.sphere.area_cm2);
    const place = $("spheres"), narrow = place.clientWidth < 560;
    const axis = (title) => ({ title: { text: title }, range: [-1.15, 1.15], showticklabels: false, showbackground: false, gridcolor: "#eef1f3", zeroline: false, showspikes: false });
    const scene = (domain) => ({ domain, xaxis: axis("X"), yaxis: axis("Y"), zaxis: axis("Z"), aspectmode: "cube",
      camera: place._fullLayout && place._fullLayout.scene ? place._fullLayout.scene.camera : CAMERA });
    const title = (text, x, y) => ({ text, x, y, xref: "paper", yref: "paper", showarrow: false, font: { size: 13 }, xanchor: "left", yanchor: "top" });
    const one = narrow ? { x: [0, 1], y: [0.51, 1] } : { x: [0, 0.49], y: [0, 1] };
    const two = narrow ? { x: [0, 1], y: [0, 0.49] } : { x: [0.51, 1], y: [0, 1] };
    place.style.height = narrow ? "640px" : "";
    const layout = { margin: { l: 0, r: 0, t: 0, b: 0 }, scene: scene(one), scene2: scene(two),
      annotations: [title(`Target: ${escape(now.views.target)}`, one.x[0] + 0.01, one.y[1]),
        title(`Source: ${escape(now.views.source)}${T === draw.IDENTITY ? "" : ", turned"}`, two.x[0] + 0.01, two.y[1])] };
    window.Plotly.react(place, [globe("scene"), normals("target", "scene", draw.IDENTITY, largest),
      globe("scene2"), normals("source", "scene2", T, largest)], layout, config);
    if (place.dataset.linked) return;
    place.dataset.linked = "yes";
    const follow = (event) => {
      if (turning) return;
      const camera = event["scene.camera"] || event["scene2.camera"];
      if (!camera) return;
      turning = true;
      const change = event["scene.camera"] ? { "scene2.camera": camera } : { "scene.camera": camera };
      window.Plotly.relayout(place, change).finally(() => { turning = false; });
    };
    place.on("plotly_relayouting", follow);
    place.on("plotly_relayout", follow);
  }
  // Plotly reads a few tags in its texts.
  function escape(text) {
    return text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  }
  function spans(traces) { // least and most of all traces along X, Y and Z
    return ["x", "y", "z"].map((n) => traces.reduce(([low, high], trace) => trace[n].reduce(
      ([a, b], v) => (Number.isNaN(v) ? [a, b] : [Math.min(a, v), Math.max(b, v)]), [low, high]), [Infinity, -Infinity]));
  }
  function shifts() {
    const found = now.shifts;
    $("shifts-part").hidden = !found;
    if (!found) return;
    const all = numbers(found.values), k = 3 * found.chosen;
    const data = [
      { ...draw.points(draw.moved(draw.IDENTITY, all.subarray(k)), { size: 2.2, color: "#8f99a2" }, "shifts"), showlegend: true },
      { ...draw.points(draw.moved(draw.IDENTITY, all.subarray(0, k)), { size: 4, color: "#d55e00" }, "in the chosen region"), showlegend: true },
    ];
    let range = null;
    if (found.box.length) {
      const [low, high] = found.box, xyz = [];
      for (const [a, b, c] of [[0, 1, 2], [1, 0, 2], [2, 0, 1]]) {
        for (const u of [low[b], high[b]]) for (const v of [low[c], high[c]]) {
          for (const w of [low[a], high[a]]) { const p = []; p[a] = w; p[b] = u; p[c] = v; xyz.push(...p); }
          xyz.push(NaN, NaN, NaN);
        }
      }
      data.push({ ...draw.lines(draw.moved(draw.IDENTITY, xyz), { color: "#d55e00", width: 3 }, "region"), showlegend: true });
      const half = Math.max(60, 2 * Math.max(...high.map((v, a) => v - low[a])));
      if ($("near").checked) range = low.map((v, a) => [(v + high[a]) / 2 - half, (v + high[a]) / 2 + half]);
    }
    const mark = (pose, symbol, color, name) => pose && data.push({
      ...draw.points([0, 1, 2].map((a) => [pose[a][3]]), { size: 6, symbol, color }, name), showlegend: true });
    mark(now.poses.exact, "square-open", "#1c2126", "exact translation");
    mark(now.poses.estimate, "diamond-open", "#0072b2", "estimate");
    const axis = (text, a) => ({ title: { text }, gridcolor: "#dfe4e8", zeroline: false, ...(range ? { range: range[a] } : {}) });
    if (range) { // plotly draws what lies beyond the axes too
      for (const trace of data) {
        if (trace.mode !== "markers") continue;
        const inside = Array.from(trace.x, (_, i) => i).filter((i) => ["x", "y", "z"].every((n, a) => trace[n][i] >= range[a][0] && trace[n][i] <= range[a][1]));
        for (const n of ["x", "y", "z"]) trace[n] = inside.map((i) => trace[n][i]);
      }
    }
    window.Plotly.react("shifts", data, { margin: { l: 0, r: 0, t: 0, b: 0 }, legend: { x: 0, y: 1, bgcolor: "rgba(255,255,255,0.8)" },
      scene: { xaxis: axis("X (mm)", 0), yaxis: axis("Y (mm)", 1), zaxis: axis("Z (mm)", 2), aspectmode: "manual",
        aspectratio: window.camera.ratio(range || spans(data), SHIFTS_CAMERA, $("shifts")), camera: SHIFTS_CAMERA } }, config);
    $("shifts-text").textContent = found.text;
  }

  async function list() {
    const body = $("found") && $("found").tBodies[0];
    if (!body || !document.getElementById("data-trials")) {
      if ($("finder")) $("finder").hidden = true;
      return;
    }
    const sought = $("sought").value.trim().toLowerCase();
    const trials = await load("trials");
    const rows = trials.filter((t) => !sought || [t.id, t.pair, t.method, t.status].some((v) => v.toLowerCase().includes(sought)));
    const SHOWN = 12;
    $("found-text").textContent = `${rows.length} of ${trials.length} trials, the worst first` + (rows.length > SHOWN ? `; ${SHOWN} are shown.` : ".")
      + (Number($("finder").dataset.total) > trials.length ? ` The run has ${$("finder").dataset.total}; the others are in trials.sqlite.` : "");
    body.replaceChildren(...rows.slice(0, SHOWN).map(row));
  }
  function row(trial) {
    const line = document.createElement("tr");
    const number = (value, digits) => (value === null ? "" : value.toFixed(digits));
    const cells = [trial.id, trial.pair, trial.method, String(trial.repeat), trial.status, number(trial.deg, 3), number(trial.mm, 2)];
    cells.forEach((text, i) => { const cell = line.insertCell(); cell.textContent = text; if (i === 3 || i > 4) cell.className = "n"; });
    const last = line.insertCell(), command = document.createElement("button");
    Object.assign(command, { type: "button", textContent: "Copy command", title: trial.command });
    command.dataset.copy = trial.command;
    last.append(command);
    if (document.getElementById("data-trial-" + trial.id)) {
      const shown = document.createElement("button");
      Object.assign(shown, { type: "button", textContent: "Show in 3D" });
      shown.dataset.show = trial.id;
      last.append(" ", shown);
    }
    return line;
  }
  if ($("spheres")) {
    window.camera.keys($("spheres"), CAMERA);
    window.camera.keys($("shifts"), SHIFTS_CAMERA);
  }
  if ($("sought")) {
    $("sought").addEventListener("input", list);
    $("turned").addEventListener("change", () => now && spheres());
    $("near").addEventListener("change", () => now && shifts());
    list();
  }
  return { row, show(record) { now = record; spheres(); shifts(); } };
})();
