"use strict";
// What the page carries compressed: JSON by its name, arrays of 16 bit numbers, the 3D library.
window.report = (function () {
  const loaded = new Map();
  async function inflate(id) {
    const text = atob(document.getElementById(id).textContent);
    const bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }
  function load(name) {
    if (!loaded.has(name)) loaded.set(name, inflate("data-" + name).then(JSON.parse));
    return loaded.get(name);
  }
  function numbers(packed) {
    const text = atob(packed.int16);
    const values = new Float32Array(text.length / 2);
    for (let i = 0; i < values.length; i++) {
      const whole = ((text.charCodeAt(2 * i) | (text.charCodeAt(2 * i + 1) << 8)) << 16) >> 16;
      values[i] = whole === -32768 ? NaN : whole * packed.step;
    }
    return values;
  }
  let library = null;
  function plotly() {
    library = library || inflate("plotly").then((text) => {
      const script = document.createElement("script");
      script.text = text;
      document.head.append(script);
      return window.Plotly;
    });
    return library;
  }
  return { load, numbers, plotly };
})();
