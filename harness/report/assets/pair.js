"use strict";
// The viewer of a pair: a slider over the stages, layers, poses and colours.
(function () {
  const form = document.getElementById("viewer");
  if (!form) return;
  const $ = (id) => document.getElementById(id);
  const { load, numbers, plotly } = window.report;
  const draw = window.traces;
  const { target: BLUE, source: ORANGE, ink: INK } = draw.colours();
  const LAYERS = [["points", "points"], ["profiles", "profiles"], ["filtered", "filtered profiles"],
    ["segments", "line segments"], ["patches", "patches"], ["normals", "normals"],
    ["frames", "sensor frames"], ["fields", "fields of view"], ["surfaces", "exact surfaces"],
    ["truth", "source at the exact pose"]];
  const POSES = [["beside", "beside the target"], ["none", "as if the sensor had not moved"], ["rotation", "turned only"],
    ["estimate", "at the estimated pose"], ["exact", "at the exact pose"]];
  const config = { responsive: true, displaylogo: false, displayModeBar: true,
    modeBarButtonsToRemove: ["tableRotation", "resetCameraLastSave3d", "hoverClosest3d"] };
  // As the sensor sees it, a little from the side: X of its frame is up, Y to the right.
  const CAMERA = { up: { x: 1, y: 0, z: 0 }, eye: { x: 0.6, y: -0.6, z: -1.25 }, projection: { type: "perspective" } };
  let now = null; // the record shown, with its scans and surroundings
  let asked = 0;

  function choices(place, kind, name, items) {
    for (const [value, text] of items) {
      const label = document.createElement("label"), input = document.createElement("input");
      Object.assign(input, { type: kind, name, value });
      input.addEventListener("change", redraw);
      label.append(input, " " + text);
      $(place).append(label);
    }
  }
  const boxes = (name) => Array.from(form.querySelectorAll(`input[name="${name}"]`));
  const picked = (name) => boxes(name).filter((box) => box.checked && !box.disabled).map((box) => box.value);

  async function show(id) {
    const turn = ++asked;
    $("told").textContent = "Loading…";
    const record = await load("trial-" + id);
    const [target, source, known] = await Promise.all(
      ["target", "source", "surroundings"].map((role) => record.files[role] && load(record.files[role])));
    await plotly();
    if (turn !== asked) return; // another one was chosen meanwhile
    now = { ...record, scans: { target, source }, known };
    $("trial").value = id;
    const there = available();
    for (const name of ["layers", "pose"]) {
      for (const box of boxes(name)) {
        box.disabled = !there[name].has(box.value);
        box.parentElement.classList.toggle("off", box.disabled);
      }
    }
    const byDistance = form.querySelector('input[name="paint"][value="distance"]');
    byDistance.disabled = !now.distances;
    byDistance.parentElement.classList.toggle("off", byDistance.disabled);
    if (byDistance.disabled) form.querySelector('input[name="paint"][value="view"]').checked = true;
    tell();
    $("stage").max = now.stages.length - 1;
    const last = now.stages.findIndex((stage) => stage.name === "Registered");
    toStage(last >= 0 ? last : now.stages.length - 1);
    window.panels.show(now);
  }
  function available() {
    const layers = new Set(["points", "profiles", "frames"]), found = now.layers;
    for (const role of ["target", "source"]) for (const name of Object.keys(found[role])) layers.add(name);
    if (now.known) layers.add("surfaces").add("fields");
    if (now.poses.exact) layers.add("truth");
    const pose = new Set(["beside", "none"]);
    if (now.poses.estimate) pose.add("rotation").add("estimate");
    if (now.poses.exact) pose.add("exact");
    return { layers, pose };
  }
  function tell() {
    const { views, status, reason, notes, error, overlap } = now;
    const named = (role) => (views[role] === role ? role : `${views[role]} (${role})`);
    let text = `${now.scene ? now.scene + ", " : ""}${named("source")} to ${named("target")}, method ${now.method}: ${status}`;
    if (reason) text += ` (${reason})`;
    if (error) text += `, off by ${error[0].toFixed(3)}° and ${error[1].toFixed(2)} mm`;
    if (overlap !== null) text += `; the target view sees ${Math.round(100 * overlap)} % of the source's points`;
    $("told").textContent = [text, ...notes.map((note) => `Note: ${note}`)].join(". ") + ".";
  }
  function toStage(place) {
    const stage = now.stages[place];
    $("stage").value = place;
    $("stage").setAttribute("aria-valuetext", stage.name);
    $("stage-name").textContent = `${place + 1} of ${now.stages.length}, ${stage.name}`;
    $("stage-text").textContent = stage.text;
    $("back").disabled = place === 0;
    $("on").disabled = place === now.stages.length - 1;
    for (const box of boxes("layers")) box.checked = stage.layers.includes(box.value);
    for (const box of boxes("pose")) box.checked = box.value === stage.pose;
    redraw();
  }
  function poseOf(name) {
    const { estimate, exact } = now.poses;
    if (name === "estimate") return estimate;
    if (name === "exact") return exact;
    if (name === "beside") return draw.shifted(besides());
    if (name !== "rotation") return draw.IDENTITY;
    return estimate.map((row, i) => (i < 3 ? [...row.slice(0, 3), 0] : row));
  }
  function besides() { // so far along Y that the views stand clear of each other
    const lateral = (role) => numbers(now.scans[role].points).filter((v, i) => i % 3 === 1 && !Number.isNaN(v));
    const most = lateral("target").reduce((a, b) => Math.max(a, b), -Infinity);
    const least = lateral("source").reduce((a, b) => Math.min(a, b), Infinity);
    return Number.isFinite(most - least) ? most - least + 80 : 0;
  }
  function traces() {
    const shown = new Set(picked("layers")), pose = poseOf(picked("pose")[0]), out = [];
    const paint = picked("paint")[0], most = farthest();
    const views = [["target", draw.IDENTITY, BLUE, "#00436b"], ["source", pose, ORANGE, "#8a5f00"]];
    views.forEach(([role, T, colour, dark], place) => {
      const scan = now.scans[role].points, found = now.layers[role];
      if (shown.has("points")) {
        if (paint === "distance") out.push(...draw.byDistance(T, scan, now.distances[role], most, place === 0));
        else out.push(draw.cloud(T, scan, colour, 1.7));
      }
      if (shown.has("profiles")) out.push(draw.profiles(T, scan, colour));
      if (shown.has("filtered") && found.filtered) out.push(draw.profiles(T, found.filtered, colour));
      if (shown.has("segments") && found.segments) out.push(draw.segments(T, found.segments, colour));
      if (shown.has("patches") && found.patches) out.push(...draw.patches(T, found.patches, dark));
      if (shown.has("normals") && found.normals) out.push(...draw.normals(T, found.normals, dark));
      if (shown.has("frames")) out.push(...draw.frame(T, role, dark, false));
    });
    if (shown.has("frames") && now.poses.exact) out.push(...draw.frame(now.poses.exact, "exact", INK, true));
    if (shown.has("truth")) out.push(draw.cloud(now.poses.exact, now.scans.source.points, "#8c8c8c", 1.5));
    if (shown.has("fields") && now.known) {
      const { outlines } = now.known;
      const T = now.poses.exact ? draw.times(pose, draw.inverse(now.poses.exact)) : pose;
      out.push(...draw.outline(draw.IDENTITY, outlines.target, BLUE), ...draw.outline(T, outlines.source, ORANGE));
    }
    if (shown.has("surfaces") && now.known) {
      out.push(draw.faces(draw.IDENTITY, now.known.surfaces, () => "#b9c2ca", 0.35));
      out.push(draw.borders(draw.IDENTITY, now.known.surfaces, { color: "#5c6670", width: 1.5 }));
    }
    return out;
  }
  function farthest() { // of the scale of distances: nine tenths of the points lie below it
    if (!now.distances) return 1;
    const all = Array.from(numbers(now.distances.source)).filter((v) => !Number.isNaN(v)).sort((a, b) => a - b);
    return Math.max(1, Math.ceil(all[Math.floor(0.9 * all.length)] || 1));
  }
  // The scene may reach farther than what was scanned: the axes hold what belongs to the scans.
  function ranges(drawn) {
    const low = [Infinity, Infinity, Infinity], high = low.map((v) => -v);
    for (const trace of drawn) {
      if (trace.type === "mesh3d" || trace.name === "borders") continue;
      [trace.x, trace.y, trace.z].forEach((axis, a) => {
        for (const v of axis) if (v < low[a]) low[a] = v;
        for (const v of axis) if (v > high[a]) high[a] = v;
      });
    }
    return low.map((v, a) => (Number.isFinite(v) && Number.isFinite(high[a])
      ? [v - 0.04 * (high[a] - v) - 5, high[a] + 0.04 * (high[a] - v) + 5] : [-100, 100]));
  }
  function redraw() {
    if (!now) return;
    const data = traces();
    const [x, y, z] = ranges(data.length ? data : [draw.cloud(draw.IDENTITY, now.scans.target.points, BLUE, 1)]);
    const axis = (title, range) => ({ title: { text: title }, range, backgroundcolor: "#fff", gridcolor: "#dfe4e8", zeroline: false, showspikes: false });
    const layout = {
      margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "kept", paper_bgcolor: "#fff", font: { color: INK, size: 11 },
      scene: { xaxis: axis("X (mm)", x), yaxis: axis("Y (mm)", y), zaxis: axis("Z (mm)", z), aspectmode: "manual",
        aspectratio: window.camera.ratio([x, y, z], CAMERA, $("space")), uirevision: "kept", dragmode: "orbit", camera: CAMERA },
    };
    window.Plotly.react("space", data, layout, config);
  }

  window.camera.keys($("space"), CAMERA);
  choices("layers", "checkbox", "layers", LAYERS);
  choices("poses", "radio", "pose", POSES);
  for (const box of boxes("paint")) box.addEventListener("change", redraw);
  $("trial").addEventListener("change", () => show($("trial").value));
  $("stage").addEventListener("input", () => now && toStage(Number($("stage").value)));
  $("back").addEventListener("click", () => now && toStage(Number($("stage").value) - 1));
  $("on").addEventListener("click", () => now && toStage(Number($("stage").value) + 1));
  document.addEventListener("click", (event) => {
    const button = event.target.closest("button[data-show]");
    if (!button) return;
    show(button.dataset.show);
    document.getElementById("pair").scrollIntoView();
    $("trial").focus({ preventScroll: true });
  });
  // Not before it is looked at: inflating the library takes a moment.
  const watch = new IntersectionObserver((entries) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    watch.disconnect();
    if (!now && !asked) show(form.dataset.first || $("trial").value);
  }, { rootMargin: "200px" });
  watch.observe(form);
})();
