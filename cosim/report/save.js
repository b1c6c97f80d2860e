// Beside every table a button that saves it as CSV, beside every picture buttons for PNG and, where it
// is drawn as SVG, for that; all of it within the browser.  A page's scripts add buttons of their own
// with CosimSave.buttons.
"use strict";
const CosimSave = (() => {
  let busy = Promise.resolve(); // until what was last asked for is saved
  const named = (name) => name.trim().replace(/[^\w.-]+/g, "_").slice(0, 80) || "cosim";
  function save(name, content, type) {
    const link = document.createElement("a");
    link.href = typeof content === "string" && content.startsWith("data:") ? content : URL.createObjectURL(new Blob([content], { type }));
    link.download = named(name);
    link.click();
    if (link.href.startsWith("blob:")) setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  const cell = (td) => {
    const text = td.dataset.value !== undefined ? td.dataset.value : td.innerText.replace(/\s+/g, " ").trim().replaceAll("−", "-");
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const csv = (table) => [...table.rows].map((row) => [...row.cells].map(cell).join(",")).join("\n") + "\n";
  const svgText = (picture) => {
    const copy = picture.cloneNode(true), [, , width, height] = picture.getAttribute("viewBox").split(" ").map(Number);
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    copy.setAttribute("width", `${width}mm`);
    copy.setAttribute("height", `${height}mm`);
    copy.setAttribute("font-family", "DejaVu Sans, Arial, sans-serif");
    return new XMLSerializer().serializeToString(copy);
  };
  const svgAddress = (picture) => `data:image/svg+xml,${encodeURIComponent(svgText(picture))}`;
  async function png(address, scale = 1) { // a picture's address as that of a PNG
    const image = new Image();
    image.src = address;
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = scale * image.width;
    canvas.height = scale * image.height;
    const pen = canvas.getContext("2d");
    pen.fillStyle = "#fff";
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(image, 0, 0, canvas.width, canvas.height);
    return canvas.toDataURL("image/png");
  }
  // A row of buttons below an element: [what it says, what it saves as (name, content or a promise of it, type)].
  function buttons(below, name, kinds) {
    const row = document.createElement("p");
    row.className = "save noprint";
    for (const [label, ending, make, type] of kinds) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = label;
      button.setAttribute("aria-label", `${label} of ${name}`);
      button.addEventListener("click", () => { busy = Promise.resolve(make()).then((content) => save(`${name}.${ending}`, content, type)); });
      row.append(button);
    }
    below.after(row);
    return row;
  }
  const ofSvg = (below, name, picture) => buttons(below, name, [["SVG", "svg", () => svgText(picture), "image/svg+xml"], ["PNG", "png", () => png(svgAddress(picture), 3), ""]]);
  function everywhere() {
    for (const table of document.querySelectorAll("main table")) {
      const around = table.closest(".scroll") || table, section = table.closest("section");
      const head = section && section.querySelector("h2");
      buttons(around, table.dataset.save || (head ? head.textContent : document.title), [["CSV", "csv", () => csv(table), "text/csv"]]);
    }
    for (const image of document.querySelectorAll("main figure img")) {
      if (!image.src) continue;
      const name = image.dataset.save || image.alt || document.title, kinds = [["PNG", "png", () => png(image.src), ""]];
      if (image.src.startsWith("data:image/svg")) kinds.unshift(["SVG", "svg", () => new TextDecoder().decode(Uint8Array.from(atob(image.src.split("base64,")[1]), (c) => c.charCodeAt(0))), "image/svg+xml"]);
      buttons(image, name, kinds);
    }
  }
  everywhere();
  return { get busy() { return busy; }, buttons, ofSvg, png, csv, svgText };
})();
