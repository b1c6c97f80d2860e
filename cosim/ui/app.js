// The page of `cosim ui`: it shows the server's state, which all tabs share, and sends what is asked.
"use strict";
(() => {
  const { CONFIG, field, fields, fixed, nearest, said } = CosimScene;
  const $ = (id) => document.getElementById(id);
  function make(tag, text = "", attributes = {}) {
    const made = Object.assign(document.createElement(tag), { textContent: text });
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    return made;
  }
  const STATUS = { solving: "Solving", done: "Solved", "at fault": "Not solved: a value is at fault", failed: "Not solved", stopped: "Stopped", waiting: "This is a motion: press Solve to run it" };
  const POSITIONS = 200; // of a slider that moves by factors
  let state = null, drawn = { views: [], picture: -1 }, controls = [], built = "", rows = new Map();
  const now = { field: "", frame: null, off: new Set(["names"]), playing: 0, camera: null, looks: 0 };

  // --- the server
  const get = (where) => fetch(where).then((answer) => answer.json());
  async function act(action, body = {}) {
    const answer = await fetch(`/do/${action}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
    const told = await answer.json();
    note(told.error || told.said || "", Boolean(told.error));
    return told;
  }
  function note(text, isWrong) {
    $("saved").textContent = text;
    $("saved").className = isWrong ? "doubt" : "";
  }
  // Changes go out one after the other; of those that wait the last one of each control alone.
  const waiting = new Map();
  let sending = false;
  async function send(key, text, drag) {
    waiting.set(key, { key, text, drag });
    if (sending) return;
    sending = true;
    try {
      while (waiting.size) {
        const [[first, body]] = waiting;
        waiting.delete(first);
        await act("change", body);
      }
    } catch { $("lost").hidden = false; } finally { sending = false; }
  }
  function listen() {
    const events = new EventSource("/events");
    events.onmessage = (event) => { $("lost").hidden = true; take(JSON.parse(event.data)); };
    events.onerror = () => { $("lost").hidden = false; };
  }
  async function take(next) {
    if (state && next.version < state.version && next.controls === state.controls) return;
    state = next;
    tell();
    if (built !== next.controls) {
      built = next.controls;
      controls = await get("/controls");
      build();
    }
    refresh();
    if (next.picture !== drawn.picture) fetchPicture();
  }
  let fetching = false;
  async function fetchPicture() { // one at a time, until the newest is there
    if (fetching) return;
    fetching = true;
    try {
      while (state.picture !== drawn.picture) {
        drawn = await get("/drawn");
        lookAt();
        await draw();
        document.documentElement.dataset.drawn = drawn.picture;
      }
    } finally { fetching = false; }
  }

  // --- words and numbers
  function tell() {
    document.title = `${state.case}: cosim`;
    $("title").textContent = state.title;
    $("status").textContent = state.status === "solving" && !state.isLive ? "Running" : STATUS[state.status];
    document.querySelector(".status").dataset.status = state.status;
    $("stage").textContent = state.stage;
    $("stop").hidden = !state.isLive || state.status !== "solving";
    $("solve").hidden = !state.isLive || !["waiting", "stopped", "failed"].includes(state.status);
    $("error").textContent = state.error ? `▲ ${state.error}` : "";
    $("error").hidden = !state.error;
    list($("other"), state.otherFaults);
    list($("warnings"), [...state.warnings, ...state.unusual].map((text) => `▲ ${text}`));
    const a = state.answer, isOld = a && !a.isCurrent;
    $("answer").textContent = a ? a.words.join(" ") : "";
    for (const id of ["answer", "strip", "panes"]) $(id).classList.toggle("old", Boolean(isOld) && state.status !== "solving");
    $("shown").textContent = shownWords(a);
    $("pin").disabled = !a;
    $("unpin").hidden = !state.pin;
    for (const id of ["opening", "doing"]) $(id).hidden = !state.isLive;
    document.querySelector(".panel").hidden = !state.isLive;
    document.querySelector(".app").style.display = state.isLive ? "" : "block";
    if (document.activeElement !== $("hood")) {
      $("hood").replaceChildren(...state.rungs.map((rung) => new Option(rung.label, rung.name)));
      $("hood").value = state.rung;
    }
    if ([...$("case").options].some((option) => option.value === state.case)) $("case").value = state.case;
    residuals();
    strip();
  }
  function shownWords(a) {
    if (state.isSoFar) return "Shown: the motion so far.";
    if (!a) return "";
    const time = a.seconds ? `, solved in ${said(a.seconds, 2)} s` : "";
    if (a.isReduced) return `Shown: the reduced hood (${a.label}); the full one follows when you let go of the slider.`;
    if (!a.isCurrent) return `Shown: the last result (${a.label})${state.status === "solving" ? "; the next one is being solved" : ", not what the controls say now"}.`;
    const sure = a.note || (a.isChecked ? " Solved from rest, as cosim run does." : " Solved from the last result; being checked from rest.");
    return `Shown: ${a.label}${time}.${a.note ? ` ${a.note}` : sure}`;
  }
  function list(at, texts) {
    at.replaceChildren(...texts.map((text) => make("li", text)));
    at.hidden = !texts.length;
  }
  function svg(tag, attributes, parent) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const name in attributes) made.setAttribute(name, attributes[name]);
    parent.append(made);
    return made;
  }
  function residuals() { // a line for each state, from 1 down to 1e-12
    const at = $("residuals"), points = state.residuals.slice(-120);
    at.replaceChildren();
    if (points.length < 2) return;
    const LOW = -12, x = (n) => 40 + (270 * n) / Math.max(points.length - 1, 1), y = (v) => 6 + (44 * Math.log10(Math.min(1, Math.max(v, 10 ** LOW)))) / LOW;
    const words = (px, py, text, anchor) => { svg("text", { x: px, y: py, "font-size": 9, "text-anchor": anchor, fill: "#59646d" }, at).textContent = text; };
    for (const power of [0, -6, LOW]) {
      svg("line", { x1: 38, x2: 312, y1: y(10 ** power), y2: y(10 ** power), stroke: "#d9dee2", "stroke-width": 1 }, at);
      words(34, y(10 ** power) + 3, power ? `1e${power}`.replace("-", "−") : "1", "end");
    }
    for (const [name, ink, dash] of [["unloaded", "#7a5195", "4 2"], ["loaded", "#00446b", ""], ["", "#00446b", ""]]) {
      const mine = points.map(([of, v], n) => [of, n, v]).filter(([of]) => of === name);
      if (!mine.length) continue;
      svg("polyline", { points: mine.map(([, n, v]) => `${x(n).toFixed(1)},${y(v).toFixed(1)}`).join(" "), fill: "none", stroke: ink, "stroke-width": 1.6, "stroke-dasharray": dash }, at);
      for (const [, n, v] of mine) svg("circle", { cx: x(n), cy: y(v), r: 2, fill: ink }, at);
      if (name) words(x(mine[0][1]), 62, name === "loaded" ? "loaded" : "at rest", "start");
    }
    words(312, 16, "relative residual", "end");
  }
  const number = (value, unit, digits = 4) => (value === null ? "–" : `${Math.abs(value) < 5e-7 ? "0" : said(value, digits)} ${unit === "1" ? "" : unit}`);
  function strip() {
    const rows = state.strip.map((row) => {
      const div = make("div"), dd = make("dd", number(row.now, row.unit));
      if (state.pin) {
        const known = row.now !== null && row.pinned !== null, gap = known ? row.now - row.pinned : null;
        const sign = gap > 0 ? "+" : "";
        dd.append(make("small", `pinned ${number(row.pinned, row.unit)}`), make("small", known ? `difference ${sign}${number(gap, row.unit, 3)}` : ""));
      }
      div.append(make("dt", row.label), dd);
      return div;
    });
    $("strip").replaceChildren(...rows);
    $("strip-head").hidden = !rows.length;
    $("strip-head").textContent = state.isMotion ? "Numbers at the end" : "Numbers under load";
  }

  // --- what is drawn
  const primary = () => drawn.views[0];
  const lastFrame = () => primary().frames.length - 1;
  function frameOf(v) { // the chosen frame, or of a pinned run the one that goes with it
    if (v !== primary()) return nearest(v, primary(), frameOf(primary()));
    return now.frame === null ? lastFrame() : Math.min(now.frame, lastFrame());
  }
  function lookAt() {
    const v = primary();
    if (!v) { $("panes").replaceChildren(); $("legend").replaceChildren(); $("parts").replaceChildren(); return; }
    if (state.isSoFar || (now.frame !== null && now.frame >= lastFrame())) now.frame = null; // the last one, as it grows
    const all = fields(v), f = field(v, now.field);
    if (f) now.field = f.key;
    $("field").replaceChildren(...all.map((one) => new Option(one.unit ? `${one.label}, ${one.unit}` : one.label, one.key)));
    if (!f) $("field").append(new Option("no deformable hood", ""));
    $("field").disabled = !f;
    $("field").value = f ? now.field : "";
    $("frame").max = lastFrame();
    $("player").hidden = lastFrame() < 1;
    for (const at of [$("play"), $("speed").parentElement]) at.hidden = !v.times.length;
    keys();
    $("parts").replaceChildren(make("legend", "Shown"), ...CosimScene.legend(drawn, v).map(({ part, words, kind, inks }) => {
      const label = make("label"), box = make("input", "", { type: "checkbox" });
      box.checked = !now.off.has(part);
      box.addEventListener("change", () => { now.off[box.checked ? "delete" : "add"](part); draw(); });
      label.append(box, ...inks.map((ink) => make("i", "", { class: kind, style: `background:${ink}` })), words);
      return label;
    }));
  }
  function keys() {
    const f = field(primary(), now.field);
    $("legend").replaceChildren(...(f ? [CosimScene.colourBar(drawn, f)] : []));
  }
  function panes(count) {
    const at = $("panes");
    while (at.children.length > count) { Plotly.purge(at.lastChild.querySelector(".room")); at.lastChild.remove(); }
    while (at.children.length < count) {
      const pane = make("div", "", { class: "pane" });
      pane.append(make("h2"), make("div", "", { class: "room", role: "img", "aria-label": "Bones, tendons and hood in three dimensions; drag to turn, scroll to come nearer" }), make("p", "", { class: "quiet" }));
      at.append(pane);
    }
    at.classList.toggle("pair", count > 1);
    return [...at.children];
  }
  async function draw() {
    if (!primary()) return;
    const all = panes(drawn.views.length), box = CosimScene.commonBox(drawn.views);
    await Promise.all(drawn.views.map((v, n) => {
      const room = all[n].querySelector(".room"), k = frameOf(v), isPinned = n > 0;
      const title = all[n].querySelector("h2");
      title.textContent = title.title = drawn.views.length < 2 ? "" : isPinned ? `Pinned: ${state.pin || ""}` : `Now: ${state.answer ? state.answer.label : ""}`;
      const angles = v.joints.map((joint, i) => `${joint.replaceAll("_", " ")} ${fixed(v.angles[k][i], 1)}°`).join(", ");
      all[n].querySelector("p").textContent = [angles, ...(v.notes || [])].join(". ");
      const parts = Object.keys(CosimScene.PARTS).filter((part) => !now.off.has(part));
      const traces = CosimScene.traces(drawn, v, k, now.field, parts);
      const [width, height] = [room.clientWidth, room.clientHeight];
      const layout = { ...CosimScene.layout(box, width, height, now.camera || CosimScene.camera("oblique", v.hand), v.hand), width, height, uirevision: now.looks };
      layout.scene.uirevision = now.looks;
      if (width < 250) for (const axis of ["xaxis", "yaxis", "zaxis"]) layout.scene[axis].visible = false; // no room for words
      return Plotly.react(room, traces, layout, CONFIG).then(() => { if (!room.dataset.heard) follow(room); });
    }));
    const k = frameOf(primary());
    $("frame").value = k;
    $("axis").textContent = state.isMotion ? "Time" : "State";
    $("label").textContent = primary().frames[k];
  }
  function follow(room) { // one camera for all panes
    room.dataset.heard = "1";
    const move = (change) => {
      const camera = change["scene.camera"];
      if (!camera) return;
      now.camera = camera;
      for (const other of document.querySelectorAll(".pane .room"))
        if (other !== room && other.layout) Plotly.relayout(other, { "scene.camera": camera });
    };
    room.on("plotly_relayout", (change) => { if (room.matches(":hover")) move(change); });
  }
  function play() {
    if (now.playing) { clearInterval(now.playing); now.playing = 0; } else {
      if (frameOf(primary()) === lastFrame()) now.frame = 0;
      let busy = false;
      now.playing = setInterval(async () => {
        if (busy) return;
        const next = frameOf(primary()) + 1;
        if (next > lastFrame()) { play(); return; }
        now.frame = next;
        busy = true;
        await draw();
        busy = false;
      }, 1000 / Number($("speed").value));
    }
    $("play").textContent = now.playing ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", String(Boolean(now.playing)));
  }

  // --- controls
  function build() {
    const open = new Set([...document.querySelectorAll(".panel details[open]")].map((d) => d.dataset.name));
    if (!open.size) for (const name of ["Posture", "Tendons", "Hood"]) open.add(name);
    rows = new Map();
    const groups = new Map();
    const folder = (name, title) => {
      const made = make("details", "", { "data-name": name });
      made.open = open.has(name);
      made.append(make("summary", title));
      return made;
    };
    for (const c of controls) {
      if (!groups.has(c.group)) groups.set(c.group, folder(c.group, c.group));
      let at = groups.get(c.group);
      if (c.part) {
        const name = `${c.group}/${c.part}`;
        if (!groups.has(name)) { groups.set(name, folder(name, c.part)); at.append(groups.get(name)); }
        at = groups.get(name);
      }
      const row = { slider: sliderRow, switch: switchRow, choice: choiceRow }[c.form](c);
      rows.set(c.key, row);
      at.append(row.at);
    }
    $("controls").replaceChildren(...[...groups].filter(([name]) => !name.includes("/")).map(([, at]) => at));
    find();
  }
  function rowOf(c, kind, inputs) {
    const at = make("div", "", { class: `control ${kind}`, "data-key": c.key }), id = `c-${c.key}`;
    const fault = make("p", "", { class: "fault", role: "alert", id: `${id}-fault` });
    const says = make("p", c.meaning, { class: "says", id: `${id}-says` });
    inputs[0].id = id;
    for (const input of inputs) input.setAttribute("aria-describedby", `${id}-says ${id}-fault`);
    fault.hidden = true;
    at.append(make("label", c.label, { for: id, title: `${c.key}` }), ...inputs, says, fault);
    return { at, fault, c };
  }
  const round = (x) => Number(x.toPrecision(3));
  function sliderRow(c) {
    const text = make("input", "", { type: "text", class: "value", spellcheck: "false" });
    const range = make("input", "", { type: "range", "aria-label": `${c.label}, slider` });
    if (c.is_log) Object.assign(range, { min: 0, max: POSITIONS, step: 1 });
    else Object.assign(range, { min: c.low, max: c.high, step: c.step || "any" });
    const toValue = (p) => (c.is_log ? c.low * (c.high / c.low) ** (p / POSITIONS) : p);
    const toPosition = (v) => (c.is_log ? (POSITIONS * Math.log(Math.max(v, 1e-300) / c.low)) / Math.log(c.high / c.low) : v);
    const spell = (p) => {
      const v = toValue(Number(p)), shown = c.step === 1 && c.is_log ? Math.round(v) : c.is_log ? round(v) : Number(v.toPrecision(6));
      return c.unit ? `${shown} ${c.unit}` : String(shown);
    };
    let moved = false;
    range.addEventListener("input", () => { moved = true; text.value = spell(range.value); send(c.key, text.value, true); });
    range.addEventListener("change", () => { moved = false; text.value = spell(range.value); send(c.key, text.value, false); });
    text.addEventListener("change", () => send(c.key, text.value.trim(), false));
    const row = rowOf(c, "slider", [text, range]);
    row.set = (value) => {
      if (document.activeElement !== text || !document.hasFocus()) text.value = value;
      const parsed = parseFloat(value), isOwn = !c.unit || value.trim().endsWith(c.unit);
      if (!moved && Number.isFinite(parsed) && isOwn) range.value = toPosition(parsed);
    };
    return row;
  }
  function switchRow(c) {
    const box = make("input", "", { type: "checkbox", role: "switch" });
    box.addEventListener("change", () => send(c.key, String(box.checked), false));
    const row = rowOf(c, "switch", [box]);
    row.set = (value) => { box.checked = value === "true"; };
    return row;
  }
  function choiceRow(c) {
    const select = make("select");
    select.append(...c.choices.map((word) => new Option(word.replaceAll("_", " "), word)));
    select.addEventListener("change", () => send(c.key, select.value, false));
    const row = rowOf(c, "choice", [select]);
    row.set = (value) => { select.value = value; };
    return row;
  }
  function refresh() { // the controls as the server has them
    for (const [key, row] of rows) {
      const changed = state.changes[key], faults = state.faults[key] || [];
      if (!waiting.has(key)) row.set(changed === undefined ? row.c.text : changed);
      row.at.classList.toggle("changed", changed !== undefined);
      row.at.classList.toggle("wrong", faults.length > 0);
      row.fault.textContent = faults.map((text) => `▲ ${text}`).join(" ");
      row.fault.hidden = !faults.length;
      if (faults.length) for (let d = row.at.closest("details"); d; d = d.parentElement.closest("details")) d.open = true;
    }
    const names = Object.entries(state.changes).filter(([key]) => rows.has(key));
    const at = $("changes");
    at.replaceChildren(names.length ? make("span", `${names.length} ${names.length === 1 ? "change" : "changes"}: `) : make("span", "Nothing is changed yet."));
    for (const [key, text] of names) {
      const c = rows.get(key).c, name = [c.part, c.label].filter(Boolean).join(", ");
      const said = c.form === "switch" ? `${text === "true" ? "" : "not "}${name}` : `${name} ${text}`, back = make("button", `${said} ✕`, { type: "button", title: `Take back; the case says ${c.text}` });
      back.addEventListener("click", () => send(key, c.text, false));
      at.append(back);
    }
    if (names.length > 1) {
      const all = make("button", "Take all back", { type: "button" });
      all.addEventListener("click", () => act("reset"));
      at.append(all);
    }
  }
  function find() {
    const words = $("find").value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows.values()) {
      const text = `${row.c.group} ${row.c.part} ${row.c.label} ${row.c.key}`.toLowerCase();
      row.at.hidden = !words.every((word) => text.includes(word));
    }
    for (const d of [...document.querySelectorAll(".panel details")].reverse()) {
      const some = [...d.querySelectorAll(".control")].some((c) => !c.hidden);
      d.hidden = !some;
      if (words.length) d.open = some;
    }
  }

  async function saveCase() { // into the browser's folder of downloads
    if (state.status === "at fault") { note("A value is at fault; correct it first.", true); return; }
    const answer = await fetch("/case.toml");
    if (!answer.ok) { note((await answer.json()).error, true); return; }
    const name = decodeURIComponent(answer.headers.get("Content-Disposition").split("''")[1]);
    const link = make("a", "", { href: URL.createObjectURL(await answer.blob()), download: name });
    link.click();
    URL.revokeObjectURL(link.href);
    note(`${name} is in your browser's downloads.`, false);
  }

  // --- begin
  async function start() {
    for (const button of document.querySelectorAll("[data-look]"))
      button.addEventListener("click", () => { now.camera = primary() ? CosimScene.camera(button.dataset.look, primary().hand) : null; now.looks += 1; draw(); });
    $("field").addEventListener("change", () => { now.field = $("field").value; keys(); draw(); });
    $("frame").addEventListener("input", () => { now.frame = Number($("frame").value); draw(); });
    $("play").addEventListener("click", play);
    $("speed").addEventListener("change", () => { if (now.playing) { play(); play(); } });
    $("stop").addEventListener("click", () => act("stop"));
    $("solve").addEventListener("click", () => act("solve"));
    $("pin").addEventListener("click", () => act("pin"));
    $("unpin").addEventListener("click", () => act("unpin"));
    $("save").addEventListener("click", () => { note("The run is being written …"); act("save"); });
    $("save-case").addEventListener("click", saveCase);
    $("hood").addEventListener("change", () => act("hood", { rung: $("hood").value }));
    $("find").addEventListener("input", find);
    $("file").addEventListener("change", async () => {
      const [file] = $("file").files;
      if (file) await act("upload", { name: file.name, text: await file.text() });
      $("file").value = "";
    });
    $("case").addEventListener("change", () => { if ($("case").value) act("open", { name: $("case").value }); });
    listen();
    const families = new Map(), shipped = await get("/cases");
    for (const one of shipped) {
      if (!families.has(one.family)) families.set(one.family, make("optgroup", "", { label: one.family }));
      families.get(one.family).append(new Option(`${one.name}: ${one.title}`, one.name));
    }
    $("case").replaceChildren(new Option("choose …", ""), ...families.values());
    if (state) $("case").value = state.case;
    addEventListener("resize", () => { clearTimeout(now.resized); now.resized = setTimeout(draw, 200); });
  }
  start();
})();
