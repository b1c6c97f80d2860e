// The state of the report's page: which runs, frame and colour its views show, and what its controls do.
"use strict";
(() => {
  const errors = [];
  window.addEventListener("error", (event) => errors.push(event.message));
  window.addEventListener("unhandledrejection", (event) => errors.push(String(event.reason)));
  const { CONFIG, FONT, extremes, field, fields, fixed, frame, nearest, numbers, said, shape } = CosimScene;
  const $ = (id) => document.getElementById(id);
  const make = (tag, text = "", attributes = {}) => {
    const made = Object.assign(document.createElement(tag), { textContent: text });
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    return made;
  };

  // --- what the page carries
  const OLD = "The views below need a newer browser: Chrome or Edge 80, Firefox 113, Safari 16.4. All tables and the picture above are complete.";
  const DIGITS = [..."0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%.()*+-;,=>?@^_`{|}~"];
  function bytes(text) { // of packing.packed: base85, five digits for four bytes
    const worth = new Uint8Array(128), length = text.length, out = new Uint8Array(4 * Math.ceil(length / 5)), whole = new DataView(out.buffer);
    DIGITS.forEach((digit, i) => { worth[digit.charCodeAt(0)] = i; });
    for (let i = 0, at = 0; i < length; i += 5, at += 4) {
      let value = 0;
      for (let j = i; j < i + 5; j++) value = 85 * value + (j < length ? worth[text.charCodeAt(j)] : 84);
      whole.setUint32(at, value % 2 ** 32);
    }
    return out.subarray(0, out.length - ((5 - (length % 5)) % 5));
  }
  function unpack(id) {
    const stream = new Blob([bytes($(id).textContent.trim())]).stream().pipeThrough(new DecompressionStream("gzip"));
    $(id).remove();
    return new Response(stream).text();
  }
  let data; // of pack_views, with `history` and `looks`

  // --- state
  const now = { field: "along", frame: 0, off: new Set(["names"]), playing: 0 };
  let camera;
  const panels = []; // what is seen beside one another: { index, stage, title, readout, still }
  const view = (panel = panels[0]) => data.views[panel.index];
  const leader = () => panels.find((panel) => view(panel).times.length) || panels[0]; // whose frames the slider counts
  const led = () => view(leader());
  const frameOf = (panel) => (panel === leader() ? now.frame : nearest(view(panel), led(), now.frame));

  // --- the views in space
  function addPanel(index) {
    const box = make("div", "", { class: "space" }), panel = { index, box, title: make("h3"), readout: make("dl", "", { class: "readout" }) };
    panel.stage = make("div", "", { class: "scene", tabindex: 0, role: "group", "aria-roledescription": "view in three dimensions" });
    panel.still = make("img", "", { class: "still", alt: "The view in space, as it was last drawn" });
    panel.still.hidden = true;
    box.append(panel.title, panel.stage, panel.still, panel.readout);
    CosimSave.buttons(panel.stage, "the view in space", [["PNG", "png", () => still(panel), ""]]);
    panel.stage.addEventListener("keydown", (event) => turn(event));
    $("spaces").append(box);
    panels.push(panel);
    return panel;
  }
  function removePanel() {
    const panel = panels.pop();
    if (panel.stage.data) Plotly.purge(panel.stage);
    panel.box.remove();
  }
  const shownParts = () => Object.keys(CosimScene.PARTS).filter((part) => !now.off.has(part));
  function drawPanel(panel, range) {
    const v = view(panel), k = frameOf(panel), traces = CosimScene.traces(data, v, k, now.field, shownParts());
    panel.title.textContent = panels.length > 1 ? `${v.name}, ${v.frames[k]}` : "";
    panel.stage.setAttribute("aria-label", `${v.name}, ${v.frames[k]}: bones, tendons and hood; arrows turn, plus and minus come nearer`);
    tell(panel, v, k);
    if (!range) { panel.stage.textContent = "There is nothing to show in space of this run."; return Promise.resolve(); }
    const first = !panel.stage.data;
    return Plotly.react(panel.stage, traces, CosimScene.layout(range, panel.stage.clientWidth, panel.stage.clientHeight, camera, v.hand), CONFIG).then(() => {
      if (!first) return;
      const follow = (change) => { if (change["scene.camera"]) look(change["scene.camera"], panel); };
      panel.stage.on("plotly_relayouting", follow);
      panel.stage.on("plotly_relayout", follow);
    });
  }
  const isSame = (a, b) => ["eye", "up", "center"].every((part) => ["x", "y", "z"].every((axis) => Math.abs(a[part][axis] - b[part][axis]) < 1e-6));
  function look(to, from) { // one camera for all views; each tells of what it is told
    if (isSame(to, camera)) return Promise.resolve();
    camera = to;
    later();
    return busy = Promise.all(panels.filter((panel) => panel !== from && panel.stage.data).map((panel) => Plotly.relayout(panel.stage, { "scene.camera": camera })));
  }
  function turn(event) {
    const { eye, up } = camera, step = Math.PI / 18;
    const about = (axis, p, angle) => { // Rodrigues
      const c = Math.cos(angle), s = Math.sin(angle), dot = axis.x * p.x + axis.y * p.y + axis.z * p.z;
      return { x: p.x * c + (axis.y * p.z - axis.z * p.y) * s + axis.x * dot * (1 - c), y: p.y * c + (axis.z * p.x - axis.x * p.z) * s + axis.y * dot * (1 - c), z: p.z * c + (axis.x * p.y - axis.y * p.x) * s + axis.z * dot * (1 - c) };
    };
    const side = { x: up.y * eye.z - up.z * eye.y, y: up.z * eye.x - up.x * eye.z, z: up.x * eye.y - up.y * eye.x }, length = Math.hypot(side.x, side.y, side.z);
    const across = { x: side.x / length, y: side.y / length, z: side.z / length };
    const near = (by) => ({ ...camera, eye: { x: by * eye.x, y: by * eye.y, z: by * eye.z } });
    const ways = { ArrowLeft: () => ({ ...camera, eye: about(up, eye, -step) }), ArrowRight: () => ({ ...camera, eye: about(up, eye, step) }),
      ArrowUp: () => ({ ...camera, eye: about(across, eye, -step), up: about(across, up, -step) }), ArrowDown: () => ({ ...camera, eye: about(across, eye, step), up: about(across, up, step) }),
      "+": () => near(0.85), "-": () => near(1 / 0.85) };
    if (!ways[event.key]) return;
    event.preventDefault();
    look(ways[event.key](), null);
  }
  let busy = Promise.resolve(); // until what was last asked for is drawn
  const draw = () => (busy = drawAll());
  function drawAll() {
    const f = field(view(), now.field), boxes = panels.map((panel) => view(panel)).filter((v) => v.box);
    const range = boxes.length ? CosimScene.commonBox(boxes) : null;
    $("frame").textContent = led().frames[now.frame];
    $("slider").setAttribute("aria-valuetext", led().frames[now.frame]);
    recolour();
    $("bar").replaceChildren(...(f ? [CosimScene.colourBar(data, f)] : []));
    $("notes").textContent = [...new Set(panels.flatMap((panel) => view(panel).notes))].join(" ");
    return Promise.all(panels.map((panel) => drawPanel(panel, view(panel).box && range))).then(later);
  }
  let waiting = 0;
  function later() { // stills of the views, for print, and the time in the charts, once all is quiet
    clearTimeout(waiting);
    if (now.playing) return;
    waiting = setTimeout(() => {
      mark();
      for (const panel of panels) still(panel).then((image) => { panel.still.src = image; panel.still.hidden = false; }, () => {});
    }, 500);
  }
  const still = (panel) => (panel.stage.data ? Plotly.toImage(panel.stage, { format: "png", width: 1000, height: 560 }) : Promise.reject(new Error("nothing is drawn")));

  // --- numbers beside
  function tell(panel, v, k) {
    const c = v.force[k], s = shape(v, k), f = field(v, now.field), size = Math.hypot(...c);
    const rows = size > 5e-4 ? [["fingertip force", `${said(size)} N`], ["distal, radial, dorsal", `${c.map((x) => fixed(x)).join(", ")} N`]] : [["fingertip", "pushes on nothing"]];
    rows.push(...Object.entries(v.slips[k]).map(([slip, x]) => [slip, `${said(x)} N`]));
    rows.push(...v.joints.map((joint, i) => [joint, `${fixed(v.angles[k][i])}°`]));
    if (s >= 0 && f) rows.push(["the colour's values", `${extremes(frame(f.values, s)).map((x) => said(x)).join(" to ")} ${f.unit}`]);
    panel.readout.replaceChildren(...rows.map(([head, text]) => {
      const div = make("div");
      div.append(make("dt", head), make("dd", text));
      return div;
    }));
  }

  // --- strain maps
  const maps = [];
  function layMaps() {
    const room = $("flats");
    if (!room) return;
    for (const v of data.views.filter((one) => one.sheet)) {
      const div = make("div", "", { class: "maps" });
      if (data.views.length > 1) div.append(make("h3", v.name));
      for (const key of ["along", "across"]) if (fields(v).some((f) => f.key === key)) div.append(map(v, key));
      room.append(div);
    }
  }
  function map(v, key) {
    const div = make("div"), one = { v, key, ...CosimScene.flatMap(data, v, key), head: make(data.views.length > 1 ? "h4" : "h3"), note: make("p", "", { class: "said quiet" }), shape: -1 };
    div.append(one.head, one.picture, one.note);
    CosimSave.ofSvg(one.note, `strain ${key} ${v.name}`, one.picture);
    one.picture.addEventListener("pointermove", (event) => {
      const n = event.target.dataset && event.target.dataset.quad;
      if (n !== undefined && one.shape >= 0) one.note.textContent = `${v.sheet.regions[v.sheet.region[n]]}: ${said(frame(one.f.values, one.shape)[n])} ${one.f.unit}`;
    });
    one.picture.addEventListener("pointerleave", () => { one.note.textContent = CosimScene.summary(one.f, one.shape); });
    maps.push(one);
    return div;
  }
  function recolour() { // every map at the slider's frame, or at its own last shape
    for (const one of maps) {
      const s = shape(one.v, nearest(one.v, led(), now.frame)), shown = s >= 0 ? s : one.v.sheet.at.length - 1;
      if (shown === one.shape) continue;
      one.shape = shown;
      one.show(shown);
      one.head.textContent = `${one.key === "along" ? "Along the fibres" : "Across the fibres"}, ${one.v.frames[one.v.sheet.at[shown]]}`;
      one.note.textContent = CosimScene.summary(one.f, shown);
    }
  }

  // --- charts over time
  const charts = [];
  function layCharts() {
    const room = $("history");
    if (!room) return [];
    for (const h of data.history) {
      if (data.history.length > 1) room.append(make("h3", h.name));
      for (const chart of h.charts) {
        const div = make("div", "", { class: "chart" }), plot = make("div", "", { class: "plot", role: "img", "aria-label": `${chart.title}: ${chart.axis}, over time; ${chart.curves.map((c) => c.name).join(", ")}` });
        const narrow = room.clientWidth < 440, lines = Math.ceil(chart.curves.length / (narrow ? 1 : 2));
        plot.style.height = `${270 + 19 * Math.max(2, lines)}px`;
        div.append(make(data.history.length > 1 ? "h4" : "h3", chart.title), plot);
        room.append(div);
        charts.push({ h, chart, plot });
      }
    }
    return charts.map(({ h, chart, plot }) => { // all rooms stand, so that each finds its width
      const x = Array.from(numbers(chart.time)), words = chart.curves.some((c) => c.name.length > 22) || chart.curves.length > 5;
      const traces = chart.curves.map(({ name, y }, i) => ({ type: "scatter", mode: "lines", x, y: Array.from(numbers(y)), name, line: data.looks[i] }));
      const axis = (text) => ({ title: { text, standoff: 8, font: { ...FONT, size: 12.5 } }, gridcolor: "#e6eaed", zerolinecolor: "#9aa5ad", ticks: "outside", ticklen: 7, tickcolor: "#fff" });
      const name = `${chart.title} ${h.name}`, image = (format) => () => Plotly.toImage(plot, { format, width: 720, height: 400 });
      const plain = (address) => decodeURIComponent(address.slice(address.indexOf(",") + 1));
      CosimSave.buttons(plot, name, [["SVG", "svg", () => image("svg")().then(plain), "image/svg+xml"], ["PNG", "png", image("png"), ""],
        ["CSV", "csv", () => [["time s", ...chart.curves.map((c) => `"${c.name}: ${chart.axis}"`)].join(","), ...x.map((t, i) => [t, ...traces.map((trace) => trace.y[i])].join(","))].join("\n"), "text/csv"]]);
      return Plotly.newPlot(plot, traces, { margin: { l: 66, r: 12, t: 8, b: 40 }, font: FONT, xaxis: axis("time, s"), yaxis: { ...axis(chart.axis), rangemode: "tozero" }, showlegend: true,
        legend: { font: { ...FONT, size: 12 }, orientation: "h", y: -0.24, yanchor: "top", entrywidth: words ? 0 : undefined }, hovermode: "x unified" }, CONFIG).then(() => {
        plot.on("plotly_click", ({ points }) => {
          const v = data.views[h.view], gaps = v.times.map((time) => Math.abs(time - points[0].x));
          go(nearest(led(), v, gaps.indexOf(Math.min(...gaps))));
        });
      });
    });
  }
  function mark() { // the slider's time in every chart
    const time = led().times[now.frame];
    for (const { plot } of charts) if (plot.layout && time !== undefined) Plotly.relayout(plot, { shapes: [{ type: "line", x0: time, x1: time, y0: 0, y1: 1, yref: "paper", line: { color: "#59646d", width: 1, dash: "dot" } }] });
  }

  // --- controls
  function choose() { // what the controls offer of the first view
    const v = view(), all = fields(v);
    if ($("field")) {
      $("field").replaceChildren(...all.map((f) => new Option(f.unit ? `${f.label}, ${f.unit}` : f.label, f.key)));
      $("field").disabled = !all.length;
      if (!all.length) $("field").append(new Option("no deformable hood"));
      else $("field").value = (field(v, now.field) || all[0]).key;
    }
    const { frames, times } = led();
    $("slider").max = frames.length - 1;
    $("slider").value = now.frame;
    $("slider").disabled = frames.length < 2;
    $("axis").textContent = times.length ? "Time" : "Load";
    $("slider").setAttribute("aria-label", $("axis").textContent);
    $("run").parentNode.hidden = data.views.length < 2;
    if ($("play")) $("play").disabled = $("speed").disabled = !times.length;
    $("parts").replaceChildren(make("legend", "Shown"), ...CosimScene.legend(data, v).map(({ part, words, kind, inks }) => {
      const label = make("label"), box = make("input", "", { type: "checkbox" });
      box.checked = !now.off.has(part);
      box.addEventListener("change", () => { if (box.checked) now.off.delete(part); else now.off.add(part); draw(); });
      label.append(box, ...inks.map((ink) => make("i", "", { class: kind, style: `background:${ink}` })), words);
      return label;
    }));
  }
  function pick() { // which runs are shown
    const before = led(), k = now.frame, beside = $("beside") ? $("beside").value : "";
    panels[0].index = Number($("run").value);
    if (beside === "" && panels.length > 1) removePanel();
    else if (beside !== "" && panels.length > 1) panels[1].index = Number(beside);
    else if (beside !== "") addPanel(Number(beside));
    $("spaces").classList.toggle("two", panels.length > 1);
    now.frame = led() === before ? k : nearest(led(), before, k);
    if (!led().times.length) stop();
    choose();
    return draw();
  }
  function go(k) {
    now.frame = k;
    $("slider").value = k;
    return draw();
  }
  function stop() {
    if (!$("play")) return;
    now.playing = 0;
    $("play").textContent = "Play";
    $("play").setAttribute("aria-pressed", "false");
    later();
  }
  function play() {
    if (now.playing) return stop();
    const turn = (now.playing = Date.now()), { times } = led(), end = times[times.length - 1];
    let time = now.frame === times.length - 1 ? times[0] : times[now.frame], last = null;
    $("play").textContent = "Pause";
    $("play").setAttribute("aria-pressed", "true");
    const step = (at) => {
      if (now.playing !== turn) return;
      if (last !== null) time += (Number($("speed").value) * (at - last)) / 1000;
      last = at;
      if (time >= end) { go(times.length - 1).then(stop); return; }
      const k = times.findLastIndex((t) => t <= time);
      if (k === now.frame) requestAnimationFrame(step);
      else go(k).then(() => requestAnimationFrame(step));
    };
    requestAnimationFrame(step);
  }
  async function start() {
    if (typeof DecompressionStream === "undefined") { $("stuck").textContent = `▲ ${OLD}`; $("stuck").hidden = false; return; }
    const [views, library] = await Promise.all([unpack("views"), unpack("plotly")]);
    data = JSON.parse(views);
    const from = (name) => CosimScene.camera(name, data.views[0].hand);
    camera = from("oblique");
    document.head.append(make("script", library));
    addPanel(0);
    if ($("beside") && matchMedia("(min-width: 900px)").matches) { $("beside").value = "1"; addPanel(1); $("spaces").classList.add("two"); }
    now.frame = led().frames.length - 1;
    choose();
    layMaps();
    $("run").addEventListener("change", pick);
    if ($("beside")) $("beside").addEventListener("change", pick);
    if ($("field")) $("field").addEventListener("change", () => { now.field = $("field").value; draw(); });
    $("slider").addEventListener("input", () => { stop(); go(Number($("slider").value)); });
    if ($("play")) $("play").addEventListener("click", play);
    for (const button of document.querySelectorAll("[data-look]")) button.addEventListener("click", () => look(from(button.dataset.look), null));
    const details = [...document.querySelectorAll("details:not(.long)")];
    window.addEventListener("beforeprint", () => details.forEach((d) => { d.open = true; }));
    await Promise.all([draw(), ...layCharts()]);
  }

  // --- what a test asks for
  async function seen() {
    const image = new Image();
    image.src = await still(panels[0]);
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = image.width; canvas.height = image.height;
    const pen = canvas.getContext("2d", { willReadFrequently: true });
    pen.drawImage(image, 0, 0);
    const pixels = new Uint32Array(pen.getImageData(0, 0, canvas.width, canvas.height).data.buffer);
    let sum = 0;
    for (const pixel of pixels) sum = (Math.imul(sum, 31) + pixel) | 0;
    const fills = maps.map((one) => one.quads.map((quad) => quad.getAttribute("fill")).join());
    return { frame: $("frame").textContent, readout: panels[0].readout.textContent, colours: new Set(pixels).size, sum, maps: fills };
  }
  function isCut(v, k) { // whether a point of a frame lies outside of the box
    if (!v.box) return false;
    return CosimScene.traces(data, v, k, now.field).some((trace) =>
      [trace.x, trace.y, trace.z].some((values, i) => values.some((x) => x !== null && (x < v.box[i][0] - 0.01 || x > v.box[i][1] + 0.01))));
  }
  window.cosimPage = { charts, draw, errors, go, isCut, look, maps, now, panels, seen, get busy() { return busy; }, get camera() { return camera; }, get data() { return data; } };
  window.cosimReady = start();
  window.cosimReady.catch((error) => errors.push(String(error)));
})();
