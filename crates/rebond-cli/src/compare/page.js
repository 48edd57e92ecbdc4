"use strict";
(() => {
  const viewer = document.getElementById("viewer");
  const area = viewer.querySelector(".views");
  const views = [...viewer.querySelectorAll(".view")];
  const at = (id) => document.getElementById(id);

  // Exposure: half floats to sRGB by a table of all 65536 of them.
  const halves = new Float32Array(65536);
  for (let i = 0; i < 65536; i++) {
    const sign = i & 0x8000 ? -1 : 1, exponent = (i >> 10) & 31, fraction = i & 1023;
    halves[i] = sign * (exponent === 0 ? fraction * 2 ** -24
      : exponent === 31 ? 65504 : (1 + fraction / 1024) * 2 ** (exponent - 15));
  }
  const shades = new Uint8Array(65536);
  const expose = (stops) => {
    const gain = 2 ** stops;
    for (let i = 0; i < 65536; i++) {
      const v = Math.min(Math.max(halves[i] * gain, 0), 1);
      shades[i] = Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
    }
  };
  const pictures = [...viewer.querySelectorAll(".halves")].map((script) => {
    const text = atob(script.textContent), pane = script.parentElement;
    const bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
    const canvas = document.createElement("canvas");
    canvas.width = pane.dataset.width;
    canvas.height = pane.dataset.height;
    // The picture below says the same to who does not see it.
    canvas.setAttribute("aria-hidden", "true");
    pane.append(canvas);
    script.remove();
    const context = canvas.getContext("2d", { willReadFrequently: true });
    return { data: new Uint16Array(bytes.buffer), context, pixels: context.createImageData(canvas.width, canvas.height) };
  });
  const draw = () => {
    const stops = Number(at("exposure").value);
    at("stops").textContent = (stops > 0 ? "+" : "") + stops;
    expose(stops);
    for (const { data, context, pixels } of pictures) {
      const out = pixels.data;
      for (let i = 0, j = 0; i < data.length; i += 3, j += 4) {
        out[j] = shades[data[i]];
        out[j + 1] = shades[data[i + 1]];
        out[j + 2] = shades[data[i + 2]];
        out[j + 3] = 255;
      }
      context.putImageData(pixels, 0, 0);
    }
  };
  let asked = false;
  at("exposure").addEventListener("input", () => {
    if (!asked) requestAnimationFrame(() => { asked = false; draw(); });
    asked = true;
  });

  // Zoom: one for all views, as x, y in widths and heights of a view, and a scale.
  let [x, y, z] = [0, 0, 1];
  const place = () => {
    z = Math.min(Math.max(z, 1), 64);
    x = Math.min(Math.max(x, 1 - z), 0);
    y = Math.min(Math.max(y, 1 - z), 0);
    area.style.setProperty("--x", x);
    area.style.setProperty("--y", y);
    area.style.setProperty("--z", z);
    area.classList.toggle("near", z > 1);
  };
  const zoom = (factor, u, v) => {
    const before = z;
    z = Math.min(Math.max(z * factor, 1), 64);
    x = u - (u - x) * z / before;
    y = v - (v - y) * z / before;
    place();
  };
  const within = (frame, event) => {
    const box = frame.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  const reset = () => { [x, y, z] = [0, 0, 1]; place(); };
  for (const frame of viewer.querySelectorAll(".frame")) {
    frame.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(2 ** (-event.deltaY / 300), ...within(frame, event));
    }, { passive: false });
    const fingers = new Map();
    frame.addEventListener("pointerdown", (event) => {
      frame.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, within(frame, event));
    });
    frame.addEventListener("pointermove", (event) => {
      const from = fingers.get(event.pointerId);
      if (!from) return;
      const to = within(frame, event);
      const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
      if (other) {
        const distance = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1e-3);
        zoom(distance(to) / distance(from), (to[0] + other[0]) / 2, (to[1] + other[1]) / 2);
      }
      const share = 1 / fingers.size;
      x += (to[0] - from[0]) * share;
      y += (to[1] - from[1]) * share;
      place();
      fingers.set(event.pointerId, to);
    });
    for (const end of ["pointerup", "pointercancel"]) frame.addEventListener(end, (e) => fingers.delete(e.pointerId));
    frame.addEventListener("dblclick", reset);
  }
  at("reset").addEventListener("click", reset);

  // Modes and layers.
  let [mode, layer, shown] = ["side", "picture", 1];
  const which = viewer.querySelector(".which");
  views.forEach((view, i) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `${i + 1} ${view.querySelector("figcaption").textContent}`;
    button.addEventListener("click", () => { shown = i; show(); });
    which.prepend(button);
  });
  which.prepend(...[...which.querySelectorAll("button")].reverse());
  const show = () => {
    viewer.dataset.mode = mode;
    viewer.dataset.layer = layer;
    for (const b of viewer.querySelectorAll("button[data-mode]")) b.setAttribute("aria-pressed", b.dataset.mode === mode);
    for (const b of viewer.querySelectorAll("button[data-layer]")) b.setAttribute("aria-pressed", b.dataset.layer === layer);
    const [left, right] = [Number(at("left").value), Number(at("right").value)];
    views.forEach((view, i) => {
      view.classList.toggle("shown", mode === "swipe" ? i === left || i === right : i === shown);
      view.classList.toggle("over", mode === "swipe" ? i === right && left !== right : i === shown);
    });
    [...which.querySelectorAll("button")].forEach((b, i) => b.setAttribute("aria-pressed", i === shown));
    area.style.setProperty("--cut", `${at("divider").value / 10}%`);
  };
  for (const b of viewer.querySelectorAll("button[data-mode]")) b.addEventListener("click", () => { mode = b.dataset.mode; show(); });
  for (const b of viewer.querySelectorAll("button[data-layer]")) b.addEventListener("click", () => { layer = b.dataset.layer; show(); });
  for (const id of ["left", "right", "divider"]) at(id).addEventListener("input", show);
  setInterval(() => {
    if (mode === "flip" && at("auto").checked) { shown = (shown + 1) % views.length; show(); }
  }, 700);
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("input, select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
    // Space presses the button that it is on.
    if (event.key === " " && event.target.closest("button")) return;
    const step = 0.1;
    const moves = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (event.key === "+" || event.key === "=") zoom(1.5, 0.5, 0.5);
    else if (event.key === "-") zoom(1 / 1.5, 0.5, 0.5);
    else if (event.key === "0") reset();
    else if (moves[event.key] && z > 1) { x += moves[event.key][0]; y += moves[event.key][1]; place(); }
    else if (mode === "flip" && event.key === " ") { shown = (shown + 1) % views.length; show(); }
    else if (mode === "flip" && event.key >= "1" && event.key <= "9" && views[event.key - 1]) { shown = event.key - 1; show(); }
    else return;
    event.preventDefault();
  });
  draw();
  place();
  show();
})();
