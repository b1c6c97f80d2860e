// The page's moving parts: the view in space, the strain maps, the curves over time.
// Loaded with #selftest it moves its slider and writes what it saw into an attribute of <html>.
"use strict";
(() => {
  const errors = [];
  window.addEventListener("error", (event) => errors.push(event.message));
  window.addEventListener("unhandledrejection", (event) => errors.push(String(event.reason)));
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("views").textContent);
  const colours = data.colours;
  const scale = colours.map((colour, i) => [i / (colours.length - 1), colour]);
  const FONT = { family: getComputedStyle(document.body).fontFamily, size: 13, color: "#1c2227" };
  const CONFIG = { displaylogo: false, responsive: true, displayModeBar: false };

  const cache = new Map();
  function numbers(packed) {
    if (!cache.has(packed)) {
      const raw = Uint8Array.from(atob(packed.b), (c) => c.charCodeAt(0)).buffer;
      cache.set(packed, packed.i ? new Uint32Array(raw) : new Float32Array(raw));
    }
    return cache.get(packed);
  }
  const size = (packed) => packed.s.slice(1).reduce((a, b) => a * b, 1);
  const frame = (packed, k) => numbers(packed).subarray(k * size(packed), (k + 1) * size(packed));
  const column = (values, i) => Array.from({ length: values.length / 3 }, (_, k) => values[3 * k + i]);
  const said = (x, digits = 3) => (x === 0 ? "0" : Number(x.toPrecision(digits)).toString()).replace("-", "−");

  // --- state
  const now = { view: 0, field: "along", frame: data.views[0].frames.length - 1 };
  const view = () => data.views[now.view];
  const field = (v, key) => v.sheet && v.sheet.fields.find((f) => f.key === key);
  // which of the sheet's shapes belongs to a frame; -1 where there is none
  const shape = (v, k) => (v.sheet ? v.sheet.at.indexOf(k) : -1);

  // --- the view in space
  function placed(bone, k) {
    const surface = data.surfaces[bone.surface], v = numbers(surface.v), p = frame(bone.pose, k);
    const out = [new Array(v.length / 3), new Array(v.length / 3), new Array(v.length / 3)];
    for (let n = 0; n < v.length / 3; n++)
      for (let i = 0; i < 3; i++)
        out[i][n] = p[4 * i] + p[4 * i + 1] * v[3 * n] + p[4 * i + 2] * v[3 * n + 1] + p[4 * i + 3] * v[3 * n + 2];
    return out;
  }
  // plotly's own light falls from where one cannot say, so the bones bring their shades along
  const LIGHT = [0.3, 0.62, 0.72], BONE = [236, 228, 208];
  function shaded(x, y, z, f) {
    const sum = new Float64Array(3 * x.length);
    for (let n = 0; n < f.length; n += 3) {
      const [a, b, c] = [f[n], f[n + 1], f[n + 2]];
      const u = [x[b] - x[a], y[b] - y[a], z[b] - z[a]], w = [x[c] - x[a], y[c] - y[a], z[c] - z[a]];
      const normal = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
      for (const corner of [a, b, c]) for (let i = 0; i < 3; i++) sum[3 * corner + i] += normal[i];
    }
    return x.map((_, n) => {
      const normal = sum.subarray(3 * n, 3 * n + 3), length = Math.hypot(...normal) || 1;
      const lit = LIGHT.reduce((total, l, i) => total + (l * normal[i]) / length, 0);
      return `rgb(${BONE.map((c) => Math.round(c * (0.74 + 0.26 * lit))).join()})`;
    });
  }
  function bones(v, k) {
    return v.bones.map((bone) => {
      const [x, y, z] = placed(bone, k), f = numbers(data.surfaces[bone.surface].f);
      return { type: "mesh3d", x, y, z, i: column(f, 0), j: column(f, 1), k: column(f, 2), hoverinfo: "skip",
        vertexcolor: shaded(x, y, z, f), lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 } };
    });
  }
  function tendons(v, k) {
    if (!v.tendons.points) return [];
    const points = numbers(v.tendons.points), x = [], y = [], z = [];
    let at = v.tendons.counts.slice(0, k).flat().reduce((a, b) => a + b, 0);
    for (const count of v.tendons.counts[k]) {
      for (let n = at; n < at + count; n++) { x.push(points[3 * n]); y.push(points[3 * n + 1]); z.push(points[3 * n + 2]); }
      x.push(null); y.push(null); z.push(null);
      at += count;
    }
    return [{ type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip", line: { color: "#2f5d50", width: 4 } }];
  }
  function sheet(v, k) {
    const s = shape(v, k), f = field(v, now.field);
    if (s < 0 || !f) return [];
    const p = frame(v.sheet.points, s), q = numbers(v.sheet.quads), values = Array.from(frame(f.values, s));
    const i = [], j = [], l = [], intensity = [], ex = [], ey = [], ez = [];
    for (let n = 0; n < q.length; n += 4) {
      i.push(q[n], q[n]); j.push(q[n + 1], q[n + 2]); l.push(q[n + 2], q[n + 3]);
      if (f.onQuads) intensity.push(values[n / 4], values[n / 4]);
      for (const corner of [0, 1, 2, 3, 0]) { const m = 3 * q[n + corner]; ex.push(p[m]); ey.push(p[m + 1]); ez.push(p[m + 2]); }
      ex.push(null); ey.push(null); ez.push(null);
    }
    return [{ type: "mesh3d", x: column(p, 0), y: column(p, 1), z: column(p, 2), i, j, k: l, hoverinfo: "skip",
      intensity: f.onQuads ? intensity : values, intensitymode: f.onQuads ? "cell" : "vertex",
      colorscale: scale, cmin: f.limits[0], cmax: f.limits[1], flatshading: true,
      lighting: { ambient: 0.9, diffuse: 0.25, specular: 0 },
      colorbar: { title: { text: `${f.label}, ${f.unit}`, side: "top", font: FONT }, orientation: "h", thickness: 12, len: 0.8,
        y: -0.02, yanchor: "top", x: 0.5, tickfont: FONT, outlinewidth: 0 } },
      { type: "scatter3d", mode: "lines", x: ex, y: ey, z: ez, hoverinfo: "skip", line: { color: "rgba(20,30,40,.35)", width: 1 } }];
  }
  function fibres(v, k) { // short strokes along each family
    const s = shape(v, k);
    if (s < 0) return [];
    return v.sheet.fibres.map(({ ink, ends }) => {
      const p = frame(ends, s), line = [[], [], []];
      for (let n = 0; n < p.length; n += 6) for (let i = 0; i < 3; i++) line[i].push(p[n + i], p[n + 3 + i], null);
      return { type: "scatter3d", mode: "lines", x: line[0], y: line[1], z: line[2], hoverinfo: "skip", line: { color: ink, width: 4 } };
    });
  }
  function force(v, k) {
    const f = v.force[k], norm = Math.hypot(...f);
    if (!numbers(v.tip).length || !(norm > 1e-6)) return [];
    const tip = frame(v.tip, k), end = Array.from(frame(v.arrow, k));
    return [{ type: "scatter3d", mode: "lines", x: [tip[0], end[0]], y: [tip[1], end[1]], z: [tip[2], end[2]], hoverinfo: "skip", line: { color: "#111", width: 6 } },
      head(end, f.map((c) => c / norm))];
  }
  function head(at, along) { // a cone of 5 mm, its point a little beyond
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const side = cross(along, Math.abs(along[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0]), length = Math.hypot(...side);
    const one = side.map((c) => (1.7 * c) / length), two = cross(along, one), turns = [...Array(12).keys()];
    const ring = turns.map((n) => at.map((c, i) => c - 3 * along[i] + Math.cos((n * Math.PI) / 6) * one[i] + Math.sin((n * Math.PI) / 6) * two[i]));
    const points = [...ring, at.map((c, i) => c + 2 * along[i])];
    return { type: "mesh3d", x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]), color: "#111", hoverinfo: "skip",
      i: turns, j: turns.map((n) => (n + 1) % 12), k: turns.map(() => 12), lighting: { ambient: 1 } };
  }
  function aspect(range) { // true to scale, and as large as the room allows
    const length = range.map(([low, high]) => high - low), room = $("scene").clientWidth / Math.max($("scene").clientHeight, 1);
    const fill = Math.min(1.75 * room, 3.3) / Math.max(...length, 2.2 * length[2]);
    return { x: fill * length[0], y: fill * length[1], z: fill * length[2] };
  }
  let camera = { eye: { x: 0.3, y: 1.8, z: 0.6 }, center: { x: 0, y: 0, z: 0 }, projection: { type: "orthographic" } };
  function layout(v) {
    const range = v.box; // the same for all frames, so that nothing jumps
    const axis = (i, name) => ({ range: range[i], title: { text: name, font: FONT }, showbackground: false, gridcolor: "#e6eaed", zeroline: false,
      tickfont: { ...FONT, size: 11 }, nticks: i === 1 ? 3 : 6, showspikes: false });
    return { margin: { l: 0, r: 0, t: 0, b: 56 }, showlegend: false, paper_bgcolor: "#fff", font: FONT, uirevision: "same",
      scene: { xaxis: axis(0, "distal, mm"), yaxis: axis(1, "radial"), zaxis: axis(2, "dorsal"), aspectmode: "manual", aspectratio: aspect(range), camera, uirevision: "same" } };
  }
  function draw() {
    const v = view(), k = now.frame;
    const traces = [...bones(v, k), ...tendons(v, k), ...sheet(v, k), ...fibres(v, k), ...force(v, k)];
    tell();
    recolour();
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
      ["distal, radial, dorsal", `${c.map((x) => x.toFixed(2).replace("-", "−")).join(", ")} N`],
      ...v.joints.map((joint, i) => [joint.replaceAll("_", " "), `${v.angles[k][i].toFixed(2).replace("-", "−")}°`])];
    if (s >= 0 && f) {
      const values = frame(f.values, s);
      rows.push(["the colour's values", `${said(Math.min(...values))} to ${said(Math.max(...values))} ${f.unit}`]);
    }
    $("readout").replaceChildren(...rows.map(([head, text]) => {
      const div = document.createElement("div"), dt = document.createElement("dt"), dd = document.createElement("dd");
      dt.textContent = head; dd.textContent = text; div.append(dt, dd); return div;
    }));
    $("notes").textContent = (v.notes || []).join(" ");
  }

  // --- strain maps
  const SVG = "http://www.w3.org/2000/svg";
  function svg(tag, attributes, parent) {
    const made = document.createElementNS(SVG, tag);
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    if (parent) parent.append(made);
    return made;
  }
  const colour = (x, [low, high]) => colours[Math.round(255 * Math.min(1, Math.max(0, (x - low) / (high - low))))];
  const maps = [];
  function layMaps() {
    const room = $("flats");
    if (!room) return;
    for (const v of data.views.filter((one) => one.sheet)) {
      const div = document.createElement("div");
      div.className = "maps";
      if (data.views.length > 1) { const h = document.createElement("h3"); h.textContent = v.name; div.append(h); }
      for (const key of ["along", "across"]) div.append(map(v, key));
      room.append(div);
    }
  }
  function map(v, key) {
    const flat = numbers(v.sheet.flat), q = numbers(v.sheet.quads), f = field(v, key);
    const us = column3(flat, 0), ws = column3(flat, 1), right = Math.max(...us), top = Math.min(...ws), bottom = Math.max(...ws);
    const x = (n) => (right - us[n] + 2).toFixed(2), y = (n) => (ws[n] - top + 8).toFixed(2);
    const width = right + 4, tall = bottom - top + 24;
    const div = document.createElement("div"), head = document.createElement("h4"), note = document.createElement("p");
    note.className = "said quiet";
    const picture = svg("svg", { viewBox: `0 0 ${width.toFixed(1)} ${tall.toFixed(1)}`, role: "img", "aria-label": f.label });
    const quads = [];
    for (let n = 0; n < q.length; n += 4) {
      const points = [0, 1, 2, 3].map((c) => `${x(q[n + c])},${y(q[n + c])}`).join(" ");
      quads.push(svg("polygon", { points, "data-quad": n / 4, "stroke-width": 0.12, "stroke-linejoin": "round" }, picture));
    }
    const zero = svg("path", { fill: "none", stroke: "#fff", "stroke-width": 0.42, "stroke-linecap": "round" }, picture);
    const edges = sides(q);
    const line = (chosen) => chosen.map(([a, b]) => `M${x(a)} ${y(a)}L${x(b)} ${y(b)}`).join("");
    const between = edges.filter(([, , one, other]) => other === undefined || v.sheet.region[one] !== v.sheet.region[other]);
    svg("path", { d: line(between), fill: "none", stroke: "#10161a", "stroke-width": 0.28, "stroke-linecap": "round" }, picture);
    legend(picture, f, width, tall, key);
    div.append(head, picture, note);
    const turns = (values) => zero.setAttribute("d", line(edges.filter(([, , a, b]) => b !== undefined && values[a] < 0 !== values[b] < 0)));
    const one = { v, key, quads, head, note, f, turns, shape: -1 };
    picture.addEventListener("pointermove", (event) => {
      const n = event.target.dataset && event.target.dataset.quad;
      if (n !== undefined && one.shape >= 0) note.textContent = `${v.sheet.regions[v.sheet.region[n]].replaceAll("_", " ")}: ${said(frame(f.values, one.shape)[n])} ${f.unit}`;
    });
    picture.addEventListener("pointerleave", () => summarise(one));
    maps.push(one);
    return div;
  }
  const column3 = (values, i) => Array.from({ length: values.length / 2 }, (_, k) => values[2 * k + i]);
  function sides(q) { // edges: two nodes, and the one or two quads beside
    const edges = new Map();
    for (let n = 0; n < q.length; n++) {
      const a = q[n], b = q[n - (n % 4) + ((n + 1) % 4)], key = a < b ? `${a},${b}` : `${b},${a}`;
      if (edges.has(key)) edges.get(key).push(n >> 2);
      else edges.set(key, [a, b, n >> 2]);
    }
    return [...edges.values()];
  }
  function legend(picture, f, width, tall, key) {
    const text = (x, y, words, anchor) => { svg("text", { x, y, "font-size": 3, "text-anchor": anchor, fill: "#3d474e" }, picture).textContent = words; };
    const id = `shade-${maps.length}`, bar = svg("linearGradient", { id }, svg("defs", {}, picture));
    for (let i = 0; i <= 16; i++) svg("stop", { offset: i / 16, "stop-color": colours[Math.round((255 * i) / 16)] }, bar);
    const left = width - 46, w = 42, at = tall - 8, [low, high] = f.limits;
    svg("rect", { x: left, y: at, width: w, height: 2.4, fill: `url(#${id})` }, picture);
    text(left, at + 5.6, said(low), "start");
    text(left + w, at + 5.6, `${said(high)} ${f.unit}`, "end");
    const zero = left + (w * -low) / (high - low);
    if (low < 0 && high > 0) {
      svg("line", { x1: zero, x2: zero, y1: at - 0.9, y2: at + 2.9, stroke: "#10161a", "stroke-width": 0.3 }, picture);
      if (zero - left > 13 && left + w - zero > 12) text(zero, at + 5.6, "0", "middle");
    }
    svg("line", { x1: 4, x2: 14, y1: at + 1.2, y2: at + 1.2, stroke: "#10161a", "stroke-width": 0.5 }, picture);
    text(4, at + 5.6, "10 mm", "start");
    text(2, 3.6, "← distal", "start");
    text(width - 2, 3.6, "ulnar ↑", "end");
  }
  function recolour() { // every map at the slider's frame, or at its own last shape
    const label = view().frames[now.frame];
    for (const one of maps) {
      const k = one.v.frames.indexOf(label), s = shape(one.v, k), shown = s >= 0 ? s : one.v.sheet.at.length - 1;
      if (shown === one.shape) continue;
      one.shape = shown;
      const values = frame(one.f.values, shown);
      one.quads.forEach((quad, n) => {
        quad.setAttribute("fill", colour(values[n], one.f.limits));
        quad.setAttribute("stroke", colour(values[n], one.f.limits));
      });
      one.turns(values);
      one.head.textContent = `${one.key === "along" ? "Along the fibres" : "Across the fibres"}, ${one.v.frames[one.v.sheet.at[shown]]}`;
      summarise(one);
    }
  }
  function summarise(one) {
    const values = frame(one.f.values, one.shape), under = values.filter((x) => x < 0).length;
    one.note.textContent = `${said(Math.min(...values))} to ${said(Math.max(...values))} ${one.f.unit} over all quads; ${Math.round((100 * under) / values.length)} % of them in compression`;
  }

  // --- curves over time
  function curves() {
    const room = $("history");
    if (!room) return [];
    const kinds = [["angles", "turned, °"], ["force", "fingertip force, N"], ["tensions", "tension, N"]];
    const wanted = data.history.flatMap((h) => kinds.map(([key, title]) => ({ h, key, title, div: document.createElement("div") })));
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
    const { xaxis, yaxis, zaxis } = layout(v).scene, axes = [xaxis.range, yaxis.range, zaxis.range];
    return [...bones(v, k), ...tendons(v, k), ...sheet(v, k), ...fibres(v, k), ...force(v, k)].some((trace) =>
      [trace.x, trace.y, trace.z].some((values, i) => values.some((x) => x !== null && (x < axes[i][0] || x > axes[i][1]))));
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
