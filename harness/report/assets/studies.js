"use strict";
// Studies: curves along one swept key, maps over two; a click on a point lists its trials.
(function () {
  const { load, plotly } = window.report;
  const { ink } = window.traces.colours();
  // Okabe and Ito, those that are dark enough for a line on white.
  const palette = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#332288", "#555555"];
  const config = { responsive: true, displaylogo: false };
  const EVERY = "(all)", ONLY = "only ";
  // Plotly reads a few tags in its texts; names from a config are text.
  const short = (value) => (typeof value === "number" ? Number(value.toPrecision(4)) : value);
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  async function begin(form) {
    const study = await load(form.dataset.study);
    const trials = new Map((await load("trials")).map((trial) => [trial.id, trial]));
    await plotly();
    const get = (name) => form.elements[name];
    const plot = form.querySelector(".plot"), text = form.querySelector(".study-text");
    const quantities = [
      ["coarse", `share within ${study.tolerances.coarse}`], ["fine", `share within ${study.tolerances.fine}`],
      ["deg", "median rotation error of the right ones (deg)"], ["mm", "median translation error of the right ones (mm)"], ["ms", "median time of the right ones (ms)"],
    ].filter(([name]) => study.points.some((point) => point[name]));
    fill(get("quantity"), quantities);
    // Of random pairs: the last key splits them by their scenes, and names stand in the order given.
    const whole = study.whole, split = whole === undefined ? -1 : study.keys.length - 1;
    fill(get("along"), study.keys.map((key, i) => [i, key]).filter(([i]) => i !== split));
    get("method").closest("label").hidden = !study.methods.length;
    fill(get("method"), [[EVERY, "all, as curves"], ...study.methods.map((method) => [method, method])]);
    let clicks = [], listed = [];

    function fill(select, items) {
      select.replaceChildren(...items.map(([value, label]) => new Option(label, value)));
    }
    function others() {
      const along = Number(get("along").value), before = get("and").value;
      const rest = study.keys.map((key, i) => [i, key]).filter(([i]) => i !== along);
      const scenes = split < 0 ? [] : sorted(study.points.map((point) => point.values[split]));
      fill(get("and"), split < 0 ? [["", "nothing"], ...rest]
        : [["", `${whole} scenes`], ...scenes.filter((name) => name !== whole).map((name) => [ONLY + name, `${name} only`]), [split, "each of the scenes"]]);
      get("and").value = [...get("and").options].some((option) => option.value === before) ? before : "";
    }
    const key = () => (get("and").value === "" || get("and").value.startsWith(ONLY) ? null : Number(get("and").value));
    const shares = () => ["coarse", "fine"].includes(get("quantity").value);
    const label = () => quantities.find(([name]) => name === get("quantity").value)[1];
    function chosen() { // of a study one at a time, the points of this key and the one all hang on
      const along = Number(get("along").value), method = get("method").value;
      return study.points.filter((point) => (method === EVERY || point.method === method)
        && (study.design !== "one_at_a_time" || point.varied === "" || point.varied === study.keys[along])
        && (split < 0 || key() !== null || point.values[split] === (get("and").value.slice(ONLY.length) || whole)));
    }
    function sorted(values) {
      const apart = [...new Set(values)];
      if (split >= 0 && apart.some((value) => typeof value !== "number")) return apart;
      return apart.sort((a, b) => (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true })));
    }
    function draw() {
      const along = Number(get("along").value), and = key();
      const map = and !== null && (get("method").value !== EVERY || !study.methods.length) && study.design === "product";
      const points = chosen();
      const axis = (title) => ({ title: { text: title, standoff: 10 }, gridcolor: "#e3e7ea", zeroline: false, automargin: true });
      const layout = { margin: { l: 60, r: 20, t: 15, b: 70 }, font: { color: ink, size: 12 }, hovermode: "closest",
        xaxis: axis(study.full[along]), yaxis: axis(label().replace(" of the right", "<br>of the right")), legend: { orientation: "h", yref: "container", y: 0, yanchor: "bottom" } };
      const numbers = points.every((point) => typeof point.values[along] === "number");
      const distinct = sorted(points.map((point) => point.values[along]));
      if (!numbers) Object.assign(layout.xaxis, { type: "category", categoryorder: "array", categoryarray: distinct.map(plain) });
      else if (distinct[0] > 0 && distinct[distinct.length - 1] / distinct[0] > 30) layout.xaxis.type = "log";
      if (shares()) layout.yaxis = { ...layout.yaxis, range: [-0.03, 1.03], tickformat: ".0%" };
      const data = map ? heat(points, along, and, layout) : curves(points, along, and, numbers);
      window.Plotly.react(plot, data, layout, config);
      const right = shares() ? "" : ` Right ones: those within ${study.tolerances.coarse}.`;
      text.textContent = (map
        ? `${study.keys.length > 2 ? "Mean over whatever else was varied; a" : "A"} click on a cell lists the trials behind it.`
        : `Bars: ${shares() ? "Wilson's 95 % interval" : study.bars || "quartiles"}; a click on a point lists the trials behind it.`) + right
        + (study.of > study.shown ? ` Drawn: ${study.shown} of the ${study.of} points, evenly over the sweep.` : "");
      form.querySelector(".behind").hidden = true;
      offer(points);
    }
    function curves(points, along, and, numbers) {
      const quantity = get("quantity").value, groups = new Map();
      const drawnFrom = !["product", "zip", "one_at_a_time"].includes(study.design);
      for (const point of points) {
        if (!point[quantity]) continue;
        const name = and === null ? point.method : `${point.method}, ${study.keys[and]} ${short(point.values[and])}`;
        const key = drawnFrom ? point.method : name;
        groups.set(key, [...(groups.get(key) || []), point]);
      }
      clicks = [];
      const symbols = ["circle", "square", "diamond", "triangle-up", "cross", "x", "star", "pentagon"];
      return [...groups].map(([name, group], place) => {
        const order = drawnFrom || and === null && split < 0 && study.keys.length > 1 && study.design === "product" ? group
          : sorted(group.map((point) => point.values[along])).flatMap((v) => group.filter((point) => point.values[along] === v));
        clicks.push(order);
        const lines = numbers && order !== group; // names have no order to be joined in
        const value = order.map((point) => point[quantity]);
        return {
          type: "scatter", mode: lines ? "lines+markers" : "markers", name: plain(name),
          x: order.map((point) => (numbers ? point.values[along] : plain(point.values[along]))), y: value.map((v) => v[0]),
          error_y: { type: "data", symmetric: false, thickness: 1, width: 3, array: value.map((v) => (v[2] ?? v[0]) - v[0]), arrayminus: value.map((v) => v[0] - (v[1] ?? v[0])) },
          marker: { size: 8, symbol: symbols[place % symbols.length], color: palette[place % palette.length] },
          line: { color: palette[place % palette.length], width: 2 },
          text: order.map((point) => [...told(point), `${point.n} trials`].map(plain).join("<br>")),
          hovertemplate: "%{text}<br>%{y:.3g}<extra></extra>",
        };
      });
    }
    function heat(points, along, and, layout) {
      const quantity = get("quantity").value;
      const columns = sorted(points.map((point) => point.values[along])), lines = sorted(points.map((point) => point.values[and]));
      const cells = lines.map((v) => columns.map((u) => points.filter((point) => point.values[along] === u && point.values[and] === v)));
      clicks = cells;
      Object.assign(layout, { yaxis: { title: { text: study.full[and], standoff: 10 }, type: "category", automargin: true, autorange: split < 0 ? true : "reversed" },
        xaxis: { title: { text: study.full[along], standoff: 10 }, type: "category", automargin: true } });
      const mean = (found) => {
        const known = found.filter((point) => point[quantity]).map((point) => point[quantity][0]);
        return known.length ? known.reduce((a, b) => a + b, 0) / known.length : null;
      };
      return [{ type: "heatmap", x: columns.map(plain), y: lines.map(plain), z: cells.map((row) => row.map(mean)),
        colorscale: "Viridis", ...(shares() ? { zmin: 0, zmax: 1 } : {}), texttemplate: shares() ? "%{z:.0%}" : "%{z:.3g}",
        showscale: plot.clientWidth > 600, colorbar: { ...(shares() ? { tickformat: ".0%" } : {}), title: { text: label().replace(" within ", "<br>within "), side: "top" } }, hovertemplate: "%{x}, %{y}: %{z:.3g}<extra></extra>" }];
    }
    const told = (point) => [point.method, ...study.keys.map((key, i) => `${key} ${short(point.values[i])}`)].filter(Boolean);
    const named = (point) => told(point).join(", ");
    // What a click does, for the keyboard: a list of the points that are drawn.
    function offer(points) {
      listed = points.filter((point) => point[get("quantity").value]);
      fill(get("point"), [["", "choose a point"], ...listed.map((point, i) => [i, named(point)])]);
    }
    function behind(points) {
      if (!points.length) return;
      const ids = points.flatMap((point) => point.ids);
      const body = form.querySelector(".behind").tBodies[0];
      form.querySelector(".behind").hidden = false;
      body.replaceChildren(...ids.filter((id) => trials.has(id)).map((id) => window.panels.row(trials.get(id))));
      const total = points.reduce((sum, point) => sum + point.n, 0);
      text.textContent = `${total} trials behind ${named(points[0])}` + (total > ids.length ? `; ${ids.length} are listed.` : ".");
    }
    for (const name of ["quantity", "and", "method"]) get(name).addEventListener("change", draw);
    get("along").addEventListener("change", () => { others(); draw(); });
    get("point").addEventListener("change", () => { if (get("point").value !== "") behind([listed[Number(get("point").value)]]); });
    others();
    draw();
    plot.on("plotly_click", (event) => {
      const { curveNumber, pointNumber } = event.points[0];
      behind(Array.isArray(pointNumber) ? clicks[pointNumber[0]][pointNumber[1]] : [clicks[curveNumber][pointNumber]]);
    });
    form.dataset.ready = "yes";
  }
  for (const form of document.querySelectorAll("form.study")) {
    const watch = new IntersectionObserver((entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      watch.disconnect();
      begin(form);
    }, { rootMargin: "200px" });
    watch.observe(form);
  }
})();
