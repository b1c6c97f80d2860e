// Draw what views.py packs: traces, layout and cameras for plotly, strain maps and colour bars as
// elements, and a legend.  No state of a page, no fixed ids: the report's page and the local app share it.
"use strict";
const CosimScene = (() => {
  const SVG = "http://www.w3.org/2000/svg";
  const INK = "#10161a", QUIET = "#3d474e", MINUS = "−";
  const BONE = [236, 228, 208], LIGHT = [0.3, 0.62, 0.72], DOT = "#b3004b";
  // Where one looks from; distal is to the left in each, from the radial side of a left hand to the right.
  const look = (eye, up) => ({ eye, up, center: { x: 0, y: 0, z: 0 }, projection: { type: "orthographic" } });
  const CAMERAS = {
    oblique: look({ x: 0.3, y: 1.8, z: 0.6 }, { x: 0, y: 0, z: 1 }),
    radial: look({ x: 0, y: 1.9, z: 0 }, { x: 0, y: 0, z: 1 }),
    dorsal: look({ x: 0, y: 0, z: 1.9 }, { x: 0, y: -1, z: 0 }),
  };
  const camera = (name, hand) => (hand === "left" && name !== "dorsal" ? { ...CAMERAS[name], eye: { ...CAMERAS[name].eye, y: -CAMERAS[name].eye.y } } : CAMERAS[name]);
  const FONT = { family: "system-ui, -apple-system, 'Segoe UI', 'Helvetica Neue', 'DejaVu Sans', Arial, sans-serif", size: 13, color: "#1c2227" };
  const CONFIG = { displaylogo: false, responsive: true, displayModeBar: false };
  const NAMED = 6; // points on a map have their names beside them up to so many
  let drawn = 0; // names the gradients of all maps apart

  // --- numbers
  const said = (x, digits = 3) => (x === 0 ? "0" : Number(x.toPrecision(digits)).toString()).replace("-", MINUS);
  const fixed = (x, digits = 2) => x.toFixed(digits).replace("-", MINUS);
  const unpacked = new WeakMap();
  function numbers(packed) { // a flat array of what views.floats or views.integers packed
    if (!unpacked.has(packed)) {
      const raw = Uint8Array.from(atob(packed.b), (c) => c.charCodeAt(0)).buffer;
      unpacked.set(packed, packed.i === 2 ? new Uint16Array(raw) : packed.i === 4 ? new Uint32Array(raw) : new Float32Array(raw));
    }
    return unpacked.get(packed);
  }
  const size = (packed) => packed.s.slice(1).reduce((a, b) => a * b, 1);
  const frame = (packed, k) => numbers(packed).subarray(k * size(packed), (k + 1) * size(packed));
  const column = (values, i, of = 3) => Array.from({ length: values.length / of }, (_, k) => values[of * k + i]);
  const extremes = (values) => values.reduce(([low, high], x) => [Math.min(low, x), Math.max(high, x)], [Infinity, -Infinity]);

  // --- what a view has
  const hoodOf = (v) => v.sheet || v.net;
  const fields = (v) => (hoodOf(v) ? hoodOf(v).fields : []);
  const field = (v, key) => fields(v).find((f) => f.key === key) || fields(v)[0] || null;
  const shape = (v, k) => (hoodOf(v) ? hoodOf(v).at.indexOf(k) : -1); // which of the hood's shapes is a frame's; -1: none
  function nearest(v, other, k) { // the frame of `v` that goes with the k-th of another view: by name, else by time, else the last
    const same = v.frames.indexOf(other.frames[k]);
    if (same >= 0 || !v.times.length || !other.times.length) return same >= 0 ? same : v.frames.length - 1;
    const gaps = v.times.map((time) => Math.abs(time - other.times[k]));
    return gaps.indexOf(Math.min(...gaps));
  }

  // --- traces
  function place(data, bone, k) {
    const v = numbers(data.surfaces[bone.surface].v), p = frame(bone.pose, k);
    return [0, 1, 2].map((i) => Array.from({ length: v.length / 3 }, (_, n) =>
      p[4 * i] + p[4 * i + 1] * v[3 * n] + p[4 * i + 2] * v[3 * n + 1] + p[4 * i + 3] * v[3 * n + 2]));
  }
  function shade(x, y, z, f) { // plotly's own light falls from where one cannot say, so the bones bring their shades along
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
  function bones(data, v, k) {
    return v.bones.map((bone) => {
      const [x, y, z] = place(data, bone, k), f = numbers(data.surfaces[bone.surface].f);
      return { type: "mesh3d", x, y, z, i: column(f, 0), j: column(f, 1), k: column(f, 2), name: bone.label, hovertemplate: `${bone.label}<extra></extra>`,
        vertexcolor: shade(x, y, z, f), lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 } };
    });
  }
  const REST = 0.1; // N; a tendon with no more is drawn as one that does not pull
  function tendons(data, v, k) {
    if (!v.tendons.points) return [];
    const points = numbers(v.tendons.points);
    let at = v.tendons.counts.slice(0, k).flat().reduce((a, b) => a + b, 0);
    return v.tendons.counts[k].map((count, i) => {
      const part = points.subarray(3 * at, 3 * (at + count)), name = v.tendons.names[k][i], tension = v.tendons.tension[k][name];
      at += count;
      const words = tension === undefined ? name : `${name}: ${said(tension)} N`;
      return { type: "scatter3d", mode: "lines", x: column(part, 0), y: column(part, 1), z: column(part, 2), name,
        hovertemplate: `${words}<extra></extra>`, line: tension <= REST ? { color: data.inks.resting, width: 4 } : { color: data.inks.tendon, width: 6 } };
    });
  }
  function sheet(data, v, k, key) {
    const s = shape(v, k), f = field(v, key);
    if (!v.sheet) return net(data, v, s, f);
    if (s < 0 || !f) return [];
    const p = frame(v.sheet.points, s), q = numbers(v.sheet.quads), values = Array.from(frame(f.values, s));
    const i = [], j = [], l = [], intensity = [], ex = [], ey = [], ez = [];
    for (let n = 0; n < q.length; n += 4) {
      i.push(q[n], q[n]); j.push(q[n + 1], q[n + 2]); l.push(q[n + 2], q[n + 3]);
      if (f.onQuads) intensity.push(values[n / 4], values[n / 4]);
      for (const corner of [0, 1, 2, 3, 0]) { const m = 3 * q[n + corner]; ex.push(p[m]); ey.push(p[m + 1]); ez.push(p[m + 2]); }
      ex.push(null); ey.push(null); ez.push(null);
    }
    return [{ type: "mesh3d", x: column(p, 0), y: column(p, 1), z: column(p, 2), i, j, k: l, hoverinfo: "skip", showscale: false,
      intensity: f.onQuads ? intensity : values, intensitymode: f.onQuads ? "cell" : "vertex",
      colorscale: ramp(data, f), cmin: f.limits[0], cmax: f.limits[1], flatshading: true,
      lighting: { ambient: 0.9, diffuse: 0.25, specular: 0 } },
      { type: "scatter3d", mode: "lines", x: ex, y: ey, z: ez, hoverinfo: "skip", line: { color: "rgba(20,30,40,.35)", width: 1 } }];
  }
  function net(data, v, s, f) { // cables, each cell in its colour
    if (!v.net || s < 0 || !f) return [];
    const p = frame(v.net.points, s), c = numbers(v.net.cells), values = frame(f.values, s);
    const x = [], y = [], z = [], color = [], text = [];
    for (let n = 0; n < c.length / 2; n++) {
      for (const node of [c[2 * n], c[2 * n + 1]]) {
        x.push(p[3 * node]); y.push(p[3 * node + 1]); z.push(p[3 * node + 2]);
        color.push(values[f.onQuads ? n : node]);
        text.push(`${v.net.names[n]}: ${said(values[f.onQuads ? n : node])} ${f.unit}`);
      }
      x.push(null); y.push(null); z.push(null); color.push(color[color.length - 1]); text.push("");
    }
    return [{ type: "scatter3d", mode: "lines", x, y, z, text, hovertemplate: "%{text}<extra></extra>",
      line: { color, colorscale: ramp(data, f), cmin: f.limits[0], cmax: f.limits[1], width: 8 } }];
  }
  const ramp = (data, f) => data.maps[f.map].map((colour, n, all) => [n / (all.length - 1), colour]);
  function dots(data, v, k) { // the user's points, with the way they went so far, and gauges between them
    if (!v.dots) return [];
    const at = (frames) => frames.map((n) => frame(v.dots.position, n)), now = frame(v.dots.position, k);
    const line = (points, ink, width, words) => ({ type: "scatter3d", mode: "lines", x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]),
      hovertemplate: `${words}<extra></extra>`, line: { color: ink, width } });
    const of = (values, i) => Array.from(values.subarray(3 * i, 3 * i + 3)), before = at([...Array(k + 1).keys()]);
    const paths = k ? v.dots.names.map((name, i) => line(before.map((p) => of(p, i)), DOT, 2, `path of ${name}`)) : [];
    const gauges = v.dots.gauges.map(({ name, ends, words }) => line(ends.map((i) => of(now, i)), DOT, 5, words || `gauge ${name}`));
    return [...paths, ...gauges, { type: "scatter3d", mode: "markers", x: column(now, 0), y: column(now, 1), z: column(now, 2), text: v.dots.words,
      hovertemplate: "%{text}<extra></extra>", marker: { color: "#fff", size: v.dots.names.length > 12 ? 3 : 5, line: { color: DOT, width: 2 } } }];
  }
  function names(data, v, k) { // of the bones, above their middles
    const middle = v.bones.map((bone) => place(data, bone, k).map((values) => extremes(values))).map((box) => [(box[0][0] + box[0][1]) / 2, box[1][1], box[2][0]]);
    return middle.length ? [{ type: "scatter3d", mode: "text", x: middle.map((p) => p[0]), y: middle.map((p) => p[1]), z: middle.map((p) => p[2] - 2),
      text: v.bones.map((bone) => bone.label), textposition: "bottom center", textfont: { ...FONT, size: 12, color: QUIET }, hoverinfo: "skip" }] : [];
  }
  function fibres(v, k) { // short strokes along each family
    const s = shape(v, k);
    if (s < 0 || !v.sheet) return [];
    return v.sheet.fibres.map(({ ink, ends }) => {
      const p = frame(ends, s), line = [[], [], []];
      for (let n = 0; n < p.length; n += 6) for (let i = 0; i < 3; i++) line[i].push(p[n + i], p[n + 3 + i], null);
      return { type: "scatter3d", mode: "lines", x: line[0], y: line[1], z: line[2], hoverinfo: "skip", line: { color: ink, width: 4 } };
    });
  }
  function force(data, v, k) {
    const f = v.force[k], norm = Math.hypot(...f);
    if (!numbers(v.tip).length || !(norm > 1e-6)) return [];
    const tip = frame(v.tip, k), end = Array.from(frame(v.arrow, k));
    return arrow(tip, end, f.map((c) => c / norm), data.inks.force, `fingertip force ${said(norm)} N`);
  }
  function arrow(from, to, along, ink, words) { // a shaft and a cone of 5 mm, its point a little beyond
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const side = cross(along, Math.abs(along[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0]), length = Math.hypot(...side);
    const one = side.map((c) => (1.7 * c) / length), two = cross(along, one), turns = [...Array(12).keys()];
    const ring = turns.map((n) => to.map((c, i) => c - 3 * along[i] + Math.cos((n * Math.PI) / 6) * one[i] + Math.sin((n * Math.PI) / 6) * two[i]));
    const points = [...ring, to.map((c, i) => c + 2 * along[i])], hovertemplate = `${words}<extra></extra>`;
    return [{ type: "scatter3d", mode: "lines", x: [from[0], to[0]], y: [from[1], to[1]], z: [from[2], to[2]], hovertemplate, line: { color: ink, width: 6 } },
      { type: "mesh3d", x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]), color: ink, hovertemplate,
        i: turns, j: turns.map((n) => (n + 1) % 12), k: turns.map(() => 12), lighting: { ambient: 1 } }];
  }
  // What can be drawn, by part: its name in a legend, and its traces in a frame.
  const PARTS = {
    bones: ["bones", bones],
    tendons: ["tendons, pulled and at rest", tendons],
    hood: ["hood", sheet],
    fibres: ["fibres of the hood", (data, v, k) => fibres(v, k)],
    force: ["fingertip force", force],
    dots: ["your points and gauges", dots],
    names: ["names of the bones", names],
  };
  const traces = (data, v, k, key, parts = Object.keys(PARTS)) => parts.flatMap((part) => PARTS[part][1](data, v, k, key));
  function legend(data, v) { // of the parts that a view has: part, words, and inks of its key
    const has = { bones: v.bones.length, tendons: v.tendons.points, hood: hoodOf(v), fibres: v.sheet && v.sheet.fibres.length,
      force: v.force.some((f) => Math.hypot(...f) > 1e-6), dots: v.dots, names: v.bones.length };
    const inks = { bones: [`rgb(${BONE.join()})`], tendons: [data.inks.tendon, data.inks.resting], hood: ["#b9bfc4"], fibres: v.sheet ? v.sheet.fibres.map((f) => f.ink) : [],
      force: [data.inks.force], dots: [DOT], names: [] };
    const kinds = { bones: "patch", hood: "patch", force: "arrow", dots: "dot" };
    const second = { fibres: inks.fibres.length > 1 ? "fibres of the hood, in the order of their families" : PARTS.fibres[0] };
    return Object.keys(PARTS).filter((part) => has[part]).map((part) => ({ part, words: second[part] || PARTS[part][0], kind: kinds[part] || "line", inks: inks[part] }));
  }

  // --- layout: true to scale, and as large as a room of width x height px allows
  function aspect(range, width, height) {
    const length = range.map(([low, high]) => high - low);
    const room = Math.max(width - 110, 100) / Math.max(height, 1); // beside what stands at the axes
    const fill = Math.min((1.85 * room) / Math.max(...length), 1.6 / length[2]);
    return { x: fill * length[0], y: fill * length[1], z: fill * length[2] };
  }
  // One box for several views, so that they are drawn to one scale.
  const commonBox = (views) => views.map((v) => v.box).filter(Boolean).reduce((a, b) => a.map(([low, high], i) => [Math.min(low, b[i][0]), Math.max(high, b[i][1])]));
  function layout(range, width, height, camera, hand) { // one range for all frames, so that nothing jumps
    const axis = (i, name) => ({ range: range[i], title: { text: name, font: FONT }, showbackground: false, gridcolor: "#e6eaed", zeroline: false,
      tickfont: { ...FONT, size: 11 }, nticks: i === 1 ? 3 : 6, showspikes: false, showticklabels: i !== 1 || width >= 600 });
    return { margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, paper_bgcolor: "#fff", font: FONT, uirevision: "same", hoverlabel: { font: FONT },
      scene: { xaxis: axis(0, "distal, mm"), yaxis: axis(1, hand === "left" ? "ulnar, mm" : "radial, mm"), zaxis: axis(2, "dorsal, mm"), aspectmode: "manual",
        aspectratio: aspect(range, width, height), camera, uirevision: "same" } };
  }

  // --- strain maps and colour bars
  function svg(tag, attributes, parent) {
    const made = document.createElementNS(SVG, tag);
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    if (parent) parent.append(made);
    return made;
  }
  const write = (parent, x, y, words, anchor, font = 3) => {
    svg("text", { x, y, "font-size": font, "text-anchor": anchor, fill: QUIET }, parent).textContent = words;
  };
  const colour = (data, f, x) => {
    const [low, high] = f.limits, colours = data.maps[f.map];
    return colours[Math.round((colours.length - 1) * Math.min(1, Math.max(0, (x - low) / (high - low))))];
  };
  function shades(data, f, parent, left, top, width, height, font) { // a bar of the field's colours with its ends and its zero
    const id = `cosim-shade-${drawn++}`, bar = svg("linearGradient", { id }, svg("defs", {}, parent)), colours = data.maps[f.map];
    for (let i = 0; i <= 16; i++) svg("stop", { offset: i / 16, "stop-color": colours[Math.round(((colours.length - 1) * i) / 16)] }, bar);
    const [low, high] = f.limits, below = top + height + 1.05 * font, zero = left + (width * -low) / (high - low);
    svg("rect", { x: left, y: top, width, height, fill: `url(#${id})` }, parent);
    write(parent, left, below, said(low), "start", font);
    write(parent, left + width, below, `${said(high)} ${f.unit}`, "end", font);
    if (low < 0 && high > 0) {
      svg("line", { x1: zero, x2: zero, y1: top - 0.3 * font, y2: top + height + 0.16 * font, stroke: INK, "stroke-width": 0.1 * font }, parent);
      if (zero - left > 4.3 * font && left + width - zero > 4.3 * font) write(parent, zero, below, "0", "middle", font);
    }
  }
  function colourBar(data, f) {
    const picture = svg("svg", { viewBox: "0 0 300 46", role: "img", "aria-label": `Colours of ${f.label}, ${said(f.limits[0])} to ${said(f.limits[1])} ${f.unit}` });
    write(picture, 2, 12, `${f.label}, ${f.unit}`, "start", 12);
    shades(data, f, picture, 2, 19, 296, 10, 12);
    return picture;
  }
  function sides(q) { // edges: two nodes, and the one or two quads beside
    const edges = new Map();
    for (let n = 0; n < q.length; n++) {
      const a = q[n], b = q[n - (n % 4) + ((n + 1) % 4)], key = a < b ? `${a},${b}` : `${b},${a}`;
      if (edges.has(key)) edges.get(key).push(n >> 2);
      else edges.set(key, [a, b, n >> 2]);
    }
    return [...edges.values()];
  }
  // The sheet laid out flat: its SVG, and what colours it as one of its shapes (0 ... at.length - 1).
  function flatMap(data, v, key) {
    const flat = numbers(v.sheet.flat), q = numbers(v.sheet.quads), f = field(v, key);
    const [, right] = extremes(column(flat, 0, 2)), [top, bottom] = extremes(column(flat, 1, 2));
    const x = (n) => (right - flat[2 * n] + 2).toFixed(2), y = (n) => (flat[2 * n + 1] - top + 8).toFixed(2);
    const width = right + 4, tall = bottom - top + 24;
    const picture = svg("svg", { viewBox: `0 0 ${width.toFixed(1)} ${tall.toFixed(1)}`, role: "img", "aria-label": `${f.label} over the hood laid out flat` });
    const quads = [];
    for (let n = 0; n < q.length; n += 4) {
      const points = [0, 1, 2, 3].map((c) => `${x(q[n + c])},${y(q[n + c])}`).join(" ");
      quads.push(svg("polygon", { points, "data-quad": n / 4, "stroke-width": 0.12, "stroke-linejoin": "round" }, picture));
    }
    const edges = sides(q), line = (chosen) => chosen.map(([a, b]) => `M${x(a)} ${y(a)}L${x(b)} ${y(b)}`).join("");
    const zero = svg("path", { fill: "none", stroke: INK, "stroke-width": 0.3, "stroke-dasharray": "0.9 0.7" }, picture);
    const between = edges.filter(([, , one, other]) => other === undefined || v.sheet.region[one] !== v.sheet.region[other]);
    svg("path", { d: line(between), fill: "none", stroke: INK, "stroke-width": 0.28, "stroke-linecap": "round" }, picture);
    if (v.dots) {
      const at = ([u, w]) => [right - u + 2, w - top + 8], { flat: where, names: called, words } = v.dots;
      for (const { name, ends, words: told } of v.dots.gauges) {
        if (!ends.every((i) => where[i])) continue;
        const [[x1, y1], [x2, y2]] = ends.map((i) => at(where[i]));
        svg("title", {}, svg("line", { x1, y1, x2, y2, stroke: DOT, "stroke-width": 0.6 }, picture)).textContent = told || `gauge ${name}`;
      }
      where.forEach((place, i) => {
        if (!place) return;
        const [cx, cy] = at(place);
        svg("title", {}, svg("circle", { cx, cy, r: 0.8, fill: "#fff", stroke: DOT, "stroke-width": 0.4 }, picture)).textContent = words[i];
        if (where.length <= NAMED) svg("text", { x: cx + 1.2, y: cy - 0.9, "font-size": 2.4, fill: INK, stroke: "#fff", "stroke-width": 0.5, "paint-order": "stroke" }, picture).textContent = called[i];
      });
    }
    shades(data, f, picture, width - 46, tall - 8, 42, 2.4, 3);
    svg("line", { x1: 4, x2: 14, y1: tall - 6.8, y2: tall - 6.8, stroke: INK, "stroke-width": 0.5 }, picture);
    write(picture, 4, tall - 2.4, "10 mm", "start");
    write(picture, 2, 3.6, "← distal", "start");
    write(picture, width - 2, 3.6, "ulnar ↑", "end");
    const show = (s) => {
      const values = frame(f.values, s);
      quads.forEach((quad, n) => { const shade = colour(data, f, values[n]); quad.setAttribute("fill", shade); quad.setAttribute("stroke", shade); });
      zero.setAttribute("d", line(edges.filter(([, , a, b]) => b !== undefined && values[a] < 0 !== values[b] < 0)));
    };
    return { picture, quads, f, show };
  }
  function summary(f, s) { // of a field over a shape
    const values = frame(f.values, s), [low, high] = extremes(values), under = values.filter((x) => x < 0).length;
    return `${said(low)} to ${said(high)} ${f.unit}; ${Math.round((100 * under) / values.length)} % in compression`;
  }

  return { CONFIG, FONT, PARTS, camera, colourBar, commonBox, extremes, field, fields, fixed, flatMap, frame, layout, legend, nearest, numbers, said, shape, summary, traces };
})();
