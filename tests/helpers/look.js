// What a test asks of a page, whichever it is: look() finds what is cut, overlaps or has no name, and
// useAll() uses every control.  The value is an object with both.
"use strict";
window.cosimTest = (() => {
  const errors = (window.testErrors = window.testErrors || []);
  const name = (element) => `${element.tagName.toLowerCase()}${element.id ? `#${element.id}` : ""} ${(element.getAttribute("aria-label") || element.textContent || "").trim().slice(0, 40)}`;
  const isShown = (element) => element.checkVisibility({ visibilityProperty: true, opacityProperty: true }) && element.getBoundingClientRect().width > 0;
  const scrolls = (element) => { for (let e = element.parentElement; e; e = e.parentElement) if (/auto|scroll/.test(getComputedStyle(e).overflowX)) return true; return false; };
  const settled = async () => { if (window.cosimPage) await window.cosimPage.busy; };
  const pause = (ms) => new Promise((done) => setTimeout(done, ms));

  function cut() { // pictures, tables and words that reach out of the window or of what hides them
    const out = [];
    for (const element of document.querySelectorAll("img, svg, canvas, table, pre, p, h1, h2, h3, h4, select, input, button, summary, dt, dd, li")) {
      if (!isShown(element) || scrolls(element) || element.closest(".modebar, .hoverlayer, .gl-container, #js-plotly-tester")) continue;
      const { left, right } = element.getBoundingClientRect();
      if (right < -900) continue; // what plotly draws out of sight to make an image of
      if (left < -1 || right > document.documentElement.clientWidth + 1) out.push(name(element));
    }
    for (const text of document.querySelectorAll("svg text")) { // of a drawing, that its own picture cuts
      const picture = text.ownerSVGElement.getBoundingClientRect(), own = text.getBoundingClientRect();
      if (!isShown(text) || !text.textContent.trim() || text.closest(".hoverlayer")) continue;
      if (own.left < picture.left - 1 || own.right > picture.right + 1 || own.top < picture.top - 1 || own.bottom > picture.bottom + 1) out.push(`text ${text.textContent}`);
    }
    return out;
  }
  function overlaps() { // labels on one another
    const out = [];
    for (const picture of document.querySelectorAll("svg")) {
      const texts = [...picture.querySelectorAll("text")].filter((t) => t.ownerSVGElement === picture && t.textContent.trim() && isShown(t) && !t.closest(".hoverlayer"));
      check(texts, out, 1.5);
    }
    for (const room of document.querySelectorAll(".controls, .save, nav, .facts, .readout, fieldset")) check([...room.children].filter(isShown), out, 1);
    return out;
  }
  function check(elements, out, slack) {
    const boxes = elements.map((e) => e.getBoundingClientRect());
    for (let i = 0; i < boxes.length; i++) for (let j = i + 1; j < boxes.length; j++) {
      const a = boxes[i], b = boxes[j];
      if (Math.min(a.right, b.right) - Math.max(a.left, b.left) > slack && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > slack) out.push(`${name(elements[i])} | ${name(elements[j])} in ${(elements[i].closest("[aria-label], section") || document.body).getAttribute("aria-label") || elements[i].closest("section").id}`);
    }
  }
  function spoken(element) { // the accessible name of a control
    const by = element.getAttribute("aria-labelledby"), labels = element.labels && element.labels.length ? [...element.labels].map((l) => l.textContent).join(" ") : "";
    return (element.getAttribute("aria-label") || (by && document.getElementById(by).textContent) || labels || element.textContent || element.alt || "").trim();
  }
  function nameless() {
    const out = [];
    for (const element of document.querySelectorAll("button, select, input, a[href], summary, [tabindex='0'], img, svg[role=img], nav")) {
      if (element.closest("[hidden], .js-plotly-plot")) continue;
      if (!spoken(element)) out.push(name(element) + element.outerHTML.slice(0, 80));
    }
    for (const section of document.querySelectorAll("section")) if (!section.querySelector("h2")) out.push(`section ${section.id} without a heading`);
    for (const picture of document.querySelectorAll("main svg")) if (!picture.closest(".js-plotly-plot") && !picture.hasAttribute("role") && picture.getAttribute("aria-hidden") !== "true") out.push(`svg ${picture.outerHTML.slice(0, 60)}`);
    const levels = [...document.querySelectorAll("h1, h2, h3, h4")].map((h) => Number(h.tagName[1]));
    levels.forEach((level, i) => { if (i && level > levels[i - 1] + 1) out.push(`heading ${level} after ${levels[i - 1]}`); });
    return out;
  }
  function unseenFocus() {
    const out = [];
    for (const element of document.querySelectorAll("button, select, input, a[href], summary, [tabindex='0']")) {
      if (!isShown(element) || element.disabled || element.closest(".js-plotly-plot .modebar")) continue;
      element.focus({ focusVisible: true, preventScroll: true });
      const { outlineStyle, outlineWidth, boxShadow } = getComputedStyle(element);
      if (document.activeElement !== element || ((outlineStyle === "none" || outlineWidth === "0px") && boxShadow === "none")) out.push(name(element));
    }
    return out;
  }
  async function useAll() { // every button, box, choice and slider; what each saved; those that changed nothing
    const saved = [], click = HTMLAnchorElement.prototype.click;
    HTMLAnchorElement.prototype.click = function keep() { saved.push([this.download, this.href.slice(0, 30)]); };
    const used = [], idle = [];
    const look = () => window.cosimPage ? JSON.stringify([...document.querySelectorAll(".space, #bar, #flats h3, #play, #frame")].map((e) => e.textContent + [...e.querySelectorAll("[fill]")].map((x) => x.getAttribute("fill")).join())) + JSON.stringify(window.cosimPage.panels.map((p) => [p.stage.data && p.stage.data.length, p.stage.layout && p.stage.layout.scene.camera, p.stage.data && p.stage.data.map((t) => t.cmax)])) : [...document.querySelectorAll("main output")].map((e) => e.value).join();
    for (const control of [...document.querySelectorAll("summary")]) if (isShown(control) && !control.parentElement.open) { control.click(); used.push(name(control)); if (!control.parentElement.open) idle.push(name(control)); }
    for (const control of [...document.querySelectorAll("main button, main select, main input")]) {
      if (!isShown(control) || control.disabled || !document.contains(control)) continue;
      if (control.dataset.look) await window.cosimPage.look({ ...window.cosimPage.camera, eye: { x: 1, y: 1, z: 1 } }, null);
      const before = look(), saves = saved.length, called = spoken(control).slice(0, 40);
      used.push(called);
      if (control.tagName === "SELECT") {
        const first = control.selectedIndex;
        control.selectedIndex = first ? 0 : control.options.length - 1;
        control.dispatchEvent(new Event("change"));
        await settled();
        if (control.options.length > 1 && look() === before && control.id !== "speed") idle.push(called);
        control.selectedIndex = first;
        control.dispatchEvent(new Event("change"));
      } else if (control.type === "range") {
        const first = control.value;
        control.value = control.min;
        control.dispatchEvent(new Event("input"));
        await settled();
        if (look() === before) idle.push(called);
        control.value = first;
        control.dispatchEvent(new Event("input"));
      } else {
        control.click();
        if (control.closest(".save")) await CosimSave.busy;
        else if (control.id === "play") await pause(1500);
        else await settled();
        if (saved.length === saves && look() === before) idle.push(called);
        if (control.id === "play" || control.type === "checkbox") control.click();
      }
      await settled();
    }
    HTMLAnchorElement.prototype.click = click;
    return { used, idle, saved, errors };
  }
  async function look() {
    if (window.cosimReady) await window.cosimReady;
    const asked = performance.getEntriesByType("resource").map((entry) => entry.name).filter((address) => !/^(data|blob):/.test(address));
    const out = { asked, width: innerWidth, fits: document.documentElement.scrollWidth <= innerWidth, cut: cut(), overlaps: overlaps(), nameless: nameless(), unseenFocus: unseenFocus(),
      empty: [...document.querySelectorAll("main img")].filter((image) => image.hasAttribute("src") && image.complete && !image.naturalWidth).map(name) };
    const page = window.cosimPage;
    if (page && page.data) {
      const slider = document.getElementById("slider");
      out.canvases = document.querySelectorAll(".scene canvas").length;
      out.outside = page.data.views.map((v) => v.frames.filter((_, k) => page.isCut(v, k))).flat();
      out.charts = page.charts.map(({ chart, plot }) => [chart.title, plot.querySelectorAll(".scatterlayer .trace").length, chart.curves.length]);
      out.seen = [];
      for (const value of [slider.max, 0]) {
        slider.value = value;
        slider.dispatchEvent(new Event("input"));
        await page.draw();
        out.seen.push(await page.seen());
      }
    }
    out.errors = errors;
    if (page && page.panels.length > 1) { // one camera
      await page.look({ ...page.camera, eye: { x: 1, y: 1, z: 1 } }, null);
      out.eyes = page.panels.map((panel) => Object.values(panel.stage.layout.scene.camera.eye));
    }
    return out;
  }
  return { look, useAll };
})();
