// The state of the report's page: which run, frame and colour its views show, and what its controls do.
// Loaded with #selftest it uses each of them and writes what it saw into an attribute of <html>.
"use strict";
(() => {
  const errors = [];
  window.addEventListener("error", (event) => errors.push(event.message));
  window.addEventListener("unhandledrejection", (event) => errors.push(String(event.reason)));
  const { CONFIG, FONT, extremes, field, fixed, frame, numbers, said, shape } = CosimScene;
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("views").textContent);
  const make = (tag, text = "", attributes = {}) => {
    const made = Object.assign(document.createElement(tag), { textContent: text });
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    return made;
  };

  // --- state
  const now = { view: 0, field: "along", frame: data.views[0].frames.length - 1 };
  const view = () => data.views[now.view];
  let camera = CosimScene.CAMERA;

  // --- the view in space
  const layout = (v) => CosimScene.layout(v.box, $("scene").clientWidth, $("scene").clientHeight, camera);
  function draw() {
    const v = view(), traces = CosimScene.traces(data, v, now.frame, now.field), f = field(v, now.field);
    tell();
    recolour();
    $("bar").replaceChildren(...(f ? [CosimScene.colourBar(data, f)] : []));
    if (!traces.length) { $("scene").textContent = "There is nothing to show in space of this run."; return Promise.resolve(); }
    return Plotly.react($("scene"), traces, layout(v), CONFIG).then(later);
  }
  let waiting = 0;
  function later() { // a still of the view, for print
    clearTimeout(waiting);
    waiting = setTimeout(() => still().then((image) => { $("still").src = image; }, () => {}), 500);
  }
  const still = () => Plotly.toImage($("scene"), { format: "png", width: 1000, height: 560 });

  // --- numbers beside
  function tell() {
    const v = view(), k = now.frame, c = v.force[k], s = shape(v, k), f = field(v, now.field);
    $("frame").textContent = v.frames[k];
    const rows = [["fingertip force", `${said(Math.hypot(...c))} N`],
      ["distal, radial, dorsal", `${c.map((x) => fixed(x)).join(", ")} N`],
      ...v.joints.map((joint, i) => [joint.replaceAll("_", " "), `${fixed(v.angles[k][i])}°`])];
    if (s >= 0 && f) rows.push(["the colour's values", `${extremes(frame(f.values, s)).map((x) => said(x)).join(" to ")} ${f.unit}`]);
    $("readout").replaceChildren(...rows.map(([head, text]) => {
      const div = make("div");
      div.append(make("dt", head), make("dd", text));
      return div;
    }));
    $("notes").textContent = (v.notes || []).join(" ");
  }

  // --- strain maps
  const maps = [];
  function layMaps() {
    const room = $("flats");
    if (!room) return;
    for (const v of data.views.filter((one) => one.sheet)) {
      const div = make("div", "", { class: "maps" });
      if (data.views.length > 1) div.append(make("h3", v.name));
      for (const key of ["along", "across"]) div.append(map(v, key));
      room.append(div);
    }
  }
  function map(v, key) {
    const div = make("div"), one = { v, key, ...CosimScene.flatMap(data, v, key), head: make("h4"), note: make("p", "", { class: "said quiet" }), shape: -1 };
    div.append(one.head, one.picture, one.note);
    one.picture.addEventListener("pointermove", (event) => {
      const n = event.target.dataset && event.target.dataset.quad;
      if (n !== undefined && one.shape >= 0) one.note.textContent = `${v.sheet.regions[v.sheet.region[n]].replaceAll("_", " ")}: ${said(frame(one.f.values, one.shape)[n])} ${one.f.unit}`;
    });
    one.picture.addEventListener("pointerleave", () => { one.note.textContent = CosimScene.summary(one.f, one.shape); });
    maps.push(one);
    return div;
  }
  function recolour() { // every map at the slider's frame, or at its own last shape
    const label = view().frames[now.frame];
    for (const one of maps) {
      const k = one.v.frames.indexOf(label), s = shape(one.v, k), shown = s >= 0 ? s : one.v.sheet.at.length - 1;
      if (shown === one.shape) continue;
      one.shape = shown;
      one.show(shown);
      one.head.textContent = `${one.key === "along" ? "Along the fibres" : "Across the fibres"}, ${one.v.frames[one.v.sheet.at[shown]]}`;
      one.note.textContent = CosimScene.summary(one.f, shown);
    }
  }

  // --- curves over time
  function curves() {
    const room = $("history");
    if (!room) return [];
    const kinds = [["angles", "turned, °"], ["force", "fingertip force, N"], ["tensions", "tension, N"]];
    const wanted = data.history.flatMap((h) => kinds.map(([key, title]) => ({ h, key, title, div: make("div") })));
    room.append(...wanted.map((one) => one.div)); // all at once, so that each finds its width
    return wanted.map(({ h, key, title, div }) => {
      const x = Array.from(numbers(h.time));
      const traces = Object.entries(h[key]).map(([name, y], i) => ({ type: "scatter", mode: "lines", x, y: Array.from(numbers(y)), name,
        line: data.looks[i] }));
      const axis = (words) => ({ title: { text: words, standoff: 6 }, gridcolor: "#e6eaed", zerolinecolor: "#9aa5ad" });
      return Plotly.newPlot(div, traces, { margin: { l: 56, r: 8, t: 26, b: 44 }, font: FONT, xaxis: axis("time, s"), yaxis: axis(title),
        title: { text: data.history.length > 1 ? h.name : "", font: FONT, x: 0.02 }, legend: { font: { ...FONT, size: 11.5 } }, hovermode: "x unified" }, CONFIG);
    });
  }

  // --- controls
  function choose() {
    const v = view(), fields = v.sheet ? v.sheet.fields : [];
    $("field").replaceChildren(...fields.map((f) => new Option(`${f.label}, ${f.unit}`, f.key)));
    $("field").disabled = !fields.length;
    if (!fields.length) $("field").append(new Option("no deformable hood"));
    else $("field").value = now.field;
    $("slider").max = v.frames.length - 1;
    $("slider").value = now.frame;
    $("run").disabled = data.views.length < 2;
  }
  function pick() {
    const label = view().frames[now.frame];
    now.view = Number($("run").value);
    const k = view().frames.indexOf(label);
    now.frame = k >= 0 ? k : view().frames.length - 1;
    choose();
    return draw();
  }
  function start() {
    choose();
    layMaps();
    $("run").addEventListener("change", pick);
    $("field").addEventListener("change", () => { now.field = $("field").value; draw(); });
    $("slider").addEventListener("input", () => { now.frame = Number($("slider").value); draw(); });

    const details = [...document.querySelectorAll("details")];
    window.addEventListener("beforeprint", () => details.forEach((d) => { d.open = true; }));
    return Promise.all([draw(), ...curves()]).then(() => {
      if ($("scene").on) $("scene").on("plotly_relayout", (change) => {
        if (change["scene.camera"]) camera = change["scene.camera"];
        later();
      });
    });
  }

  // --- what a test asks for
  async function seen() {
    const image = new Image();
    image.src = await still();
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = image.width; canvas.height = image.height;
    const pen = canvas.getContext("2d");
    pen.drawImage(image, 0, 0);
    const pixels = new Uint32Array(pen.getImageData(0, 0, canvas.width, canvas.height).data.buffer);
    let sum = 0;
    for (const pixel of pixels) sum = (Math.imul(sum, 31) + pixel) | 0;
    const fills = maps.map((one) => one.quads.map((quad) => quad.getAttribute("fill")).join());
    return { frame: $("frame").textContent, readout: $("readout").textContent, colours: new Set(pixels).size, sum, maps: fills };
  }
  function isCut(v, k) { // whether a point of a frame lies outside of the box
    if (!v.box) return false;
    return CosimScene.traces(data, v, k, now.field).some((trace) =>
      [trace.x, trace.y, trace.z].some((values, i) => values.some((x) => x !== null && (x < v.box[i][0] || x > v.box[i][1]))));
  }
  async function selftest() {
    const asked = performance.getEntriesByType("resource").map((entry) => entry.name);
    const out = { requests: asked.filter((name) => !/^(data|blob):/.test(name)), fits: document.documentElement.scrollWidth <= innerWidth, canvases: document.querySelectorAll("#scene canvas").length, cut: data.views.map((v) => v.frames.filter((_, k) => isCut(v, k))).flat(), seen: [], errors };
    for (const value of [$("slider").max, 0]) {
      $("slider").value = value;
      now.frame = Number(value);
      await draw();
      out.seen.push(await seen());
    }
    document.documentElement.dataset.selftest = JSON.stringify(out);
  }

  start().then(() => (location.hash === "#selftest" ? selftest() : null)).catch((error) => {
    errors.push(String(error));
    document.documentElement.dataset.selftest = JSON.stringify({ errors });
    throw error;
  });
})();
