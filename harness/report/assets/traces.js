"use strict";
// The layers of a pair as traces of plotly; poses are 4 x 4 matrices by rows, T_target_source.
window.traces = (function () {
  const { numbers } = window.report;
  const IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
  const GREY = "#9aa3ab";
  const colours = () => JSON.parse(document.getElementById("colours").textContent);

  function times(A, B) {
    return A.map((row) => [0, 1, 2, 3].map((j) => row.reduce((sum, v, k) => sum + v * B[k][j], 0)));
  }
  function inverse(T) {
    const R = [0, 1, 2].map((i) => [0, 1, 2].map((j) => T[j][i]));
    const t = R.map((row) => -(row[0] * T[0][3] + row[1] * T[1][3] + row[2] * T[2][3]));
    return [...R.map((row, i) => [...row, t[i]]), [0, 0, 0, 1]];
  }
  function shifted(lateral) {
    return [[1, 0, 0, 0], [0, 1, 0, lateral], [0, 0, 1, 0], [0, 0, 0, 1]];
  }
  function moved(T, xyz) { // flat x, y, z, x, y, z, ... to three arrays
    const n = xyz.length / 3;
    const out = [new Float32Array(n), new Float32Array(n), new Float32Array(n)];
    for (let i = 0; i < n; i++) {
      const x = xyz[3 * i], y = xyz[3 * i + 1], z = xyz[3 * i + 2];
      for (let a = 0; a < 3; a++) out[a][i] = T[a][0] * x + T[a][1] * y + T[a][2] * z + T[a][3];
    }
    return out;
  }
  function points([x, y, z], marker, name) {
    return { type: "scatter3d", mode: "markers", x, y, z, marker, name, hoverinfo: "skip", showlegend: false };
  }
  function lines([x, y, z], line, name) {
    return { type: "scatter3d", mode: "lines", x, y, z, line, name, hoverinfo: "skip", showlegend: false };
  }
  // Polylines of one trace are apart where a NaN stands.
  function apart(xyz, lengths) {
    const out = new Float32Array(xyz.length + 3 * lengths.length).fill(NaN);
    let from = 0, to = 0;
    for (const k of lengths) {
      out.set(xyz.subarray(3 * from, 3 * (from + k)), 3 * to);
      from += k;
      to += k + 1;
    }
    return out;
  }
  function cloud(T, packed, colour, size) {
    return points(moved(T, numbers(packed)), { size, color: colour }, "points");
  }
  function byDistance(T, packed, distance, most, bar) {
    const xyz = moved(T, numbers(packed)), away = numbers(distance);
    const split = (known) => {
      const keep = [];
      away.forEach((v, i) => { if (Number.isNaN(v) !== known && !Number.isNaN(xyz[2][i])) keep.push(i); });
      return [xyz.map((axis) => Float32Array.from(keep, (i) => axis[i])), Float32Array.from(keep, (i) => away[i])];
    };
    const [far] = split(false), [near, values] = split(true);
    const marker = { size: 2, color: values, colorscale: "Viridis", cmin: 0, cmax: most, showscale: bar };
    if (bar) marker.colorbar = { title: { text: "Distance<br>(mm)", side: "top" }, len: 0.6, thickness: 14, x: 1, xanchor: "right" };
    return [points(far, { size: 1.5, color: "#c9ced3" }, "nothing there"), points(near, marker, "distance")];
  }
  function profiles(T, packed, colour) {
    const [rows, pixels] = packed.shape;
    const lengths = new Array(rows).fill(pixels);
    return lines(moved(T, apart(numbers(packed), lengths)), { color: colour, width: 1.5 }, "profiles");
  }
  function segments(T, packed, colour) {
    const lengths = new Array(packed.ends.shape[0]).fill(2);
    return lines(moved(T, apart(numbers(packed.ends), lengths)), { color: colour, width: 2.5 }, "segments");
  }
  function fan(sizes) { // triangles of convex polygons, and the polygon of each
    const i = [], j = [], k = [], of = [];
    let first = 0;
    sizes.forEach((size, polygon) => {
      for (let corner = 1; corner + 1 < size; corner++) {
        i.push(first); j.push(first + corner); k.push(first + corner + 1); of.push(polygon);
      }
      first += size;
    });
    return { i, j, k, of };
  }
  function borders(T, layer, line) {
    const xyz = numbers(layer.corners), closed = [];
    let first = 0;
    for (const size of layer.sizes) {
      for (let corner = 0; corner <= size; corner++) {
        const at = 3 * (first + (corner % size));
        closed.push(xyz[at], xyz[at + 1], xyz[at + 2]);
      }
      closed.push(NaN, NaN, NaN);
      first += size;
    }
    return lines(moved(T, closed), line, "borders");
  }
  function faces(T, layer, facecolor, opacity) {
    const [x, y, z] = moved(T, numbers(layer.corners)), { i, j, k, of } = fan(layer.sizes);
    return {
      type: "mesh3d", x, y, z, i, j, k, facecolor: of.map(facecolor), opacity, flatshading: true,
      lighting: { ambient: 0.85, diffuse: 0.3, specular: 0 }, hoverinfo: "skip", showlegend: false,
    };
  }
  function patches(T, layer, edge) {
    const { palette } = colours();
    const colour = (polygon) => (layer.colour[polygon] < 0 ? GREY : palette[layer.colour[polygon]]);
    return [faces(T, layer, colour, 0.75), borders(T, layer, { color: edge, width: 2 })];
  }
  function normals(T, layer, ink) {
    const from = numbers(layer.from), direction = numbers(layer.direction), xyz = [];
    for (let i = 0; i < from.length; i += 3) {
      for (const length of [0, 60]) for (let a = 0; a < 3; a++) xyz.push(from[i + a] + length * direction[i + a]);
      xyz.push(NaN, NaN, NaN);
    }
    const drawn = moved(T, xyz), tips = drawn.map((axis) => axis.filter((_, i) => i % 3 === 1));
    return [lines(drawn, { color: ink, width: 3 }, "normals"), points(tips, { size: 2.5, color: ink }, "tips")];
  }
  function frame(T, name, ink, dashed) {
    const size = 120, axes = [];
    [["X", "#cc6677"], ["Y", "#117733"], ["Z", "#332288"]].forEach(([axis, colour], a) => {
      const tip = [0, 0, 0];
      tip[a] = size;
      const [x, y, z] = moved(T, [0, 0, 0, ...tip]);
      axes.push({
        type: "scatter3d", mode: "lines+text", x, y, z, text: [a === 0 ? name : "", axis],
        textposition: dashed ? "top center" : "bottom center", textfont: { size: 12, color: ink }, hoverinfo: "skip", showlegend: false,
        line: { color: colour, width: dashed ? 3 : 6, dash: dashed ? "dash" : "solid" },
      });
    });
    return axes;
  }
  function outline(T, packed, colour) {
    return packed.map((line) => lines(moved(T, numbers(line)), { color: colour, width: 2, dash: "dot" }, "field"));
  }
  return { IDENTITY, shifted, GREY, colours, times, inverse, moved, points, lines, cloud, byDistance, profiles,
    segments, faces, borders, patches, normals, frame, outline };
})();
