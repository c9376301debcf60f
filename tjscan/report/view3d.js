"use strict";
// The groove in space, to turn: plain WebGL without a library. If there is none, the still
// picture stays. Units are the data's: millimetres, in the frame of the result.
(() => {
  const figure = document.getElementById("view3d");
  const scene = JSON.parse(document.getElementById("view3d-data").textContent);
  const [canvas, paper] = figure.querySelectorAll("canvas");
  const gl = canvas.getContext("webgl"), pen = paper.getContext("2d");
  if (!gl) return;
  const find = name => figure.querySelector(`[name=${name}]`);
  const readout = figure.querySelector("output"), choice = find("quantity");

  // ---- vectors
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const plus = (a, b, share = 1) => a.map((v, i) => v + share * b[i]);
  const unit = a => { const n = Math.hypot(...a) || 1; return a.map(v => v / n); };
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

  // ---- programs: faces and points, lit where they have a normal; lines, of a breadth in pixels
  const FACES = [["at", 3], ["normal", 3], ["colour", 4]];
  const LINES = [["at", 3], ["to", 3], ["breadth", 1], ["colour", 4]];
  const faces = program(FACES, `uniform vec3 eye; uniform float size;
    void main() {
      gl_Position = view * vec4(at, 1.0);
      gl_PointSize = size;
      float light = normal == vec3(0.0) ? 1.0 : 0.7 + 0.3 * abs(dot(normal, eye));
      shade = vec4(colour.rgb * light, colour.a);
    }`);
  const lines = program(LINES, `uniform vec2 pixels;
    void main() {
      vec4 here = view * vec4(at, 1.0);
      vec2 along = ((view * vec4(to, 1.0)).xy - here.xy) * pixels;
      along = length(along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
      gl_Position = here + vec4(breadth * vec2(-along.y, along.x) / pixels, -0.001, 0.0);
      shade = colour;
    }`);

  function program(layout, main) {
    const made = gl.createProgram();
    const head = "uniform mat4 view; varying vec4 shade;" +
      layout.map(([name, n]) => `attribute ${n === 1 ? "float" : "vec" + n} ${name};`).join("");
    const paint = "precision mediump float; varying vec4 shade;" +
      "void main() { gl_FragColor = vec4(shade.rgb * shade.a, shade.a); }";
    for (const [kind, text] of [[gl.VERTEX_SHADER, head + main], [gl.FRAGMENT_SHADER, paint]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return {made, layout, floats: layout.reduce((sum, [, n]) => sum + n, 0)};
  }

  function fill(batch, kind, mode, numbers) {
    const buffer = batch ? batch.buffer : gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(numbers), gl.STATIC_DRAW);
    return {buffer, kind, mode, count: numbers.length / kind.floats};
  }

  // ---- what is drawn
  const sections = scene.sections;
  const corners = sections.flatMap(one => one.corners);
  const shorts = text => new Int16Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const steps = shorts(scene.points.at), micrometres = shorts(scene.points.micrometres);
  const colour = (hex, alpha = 1) =>
    [1, 3, 5].map(k => parseInt(hex.slice(k, k + 2), 16) / 255).concat(alpha);

  function shade(quantity, value, alpha = 1) {
    if (value === null) return [0.6, 0.6, 0.6, alpha];
    const n = quantity.colours.length - 1;
    const share = (value - quantity.low) / (quantity.high - quantity.low);
    const place = Math.min(Math.max(share, 0), 1) * n, k = Math.min(Math.floor(place), n - 1);
    const [a, b] = [colour(quantity.colours[k]), colour(quantity.colours[k + 1])];
    return [0, 1, 2].map(i => a[i] + (place - k) * (b[i] - a[i])).concat(alpha);
  }

  const triangle = (out, points, tints) => {
    const normal = unit(cross(minus(points[1], points[0]), minus(points[2], points[0])));
    points.forEach((point, k) => out.push(...point, ...normal, ...tints[k]));
  };
  const line = (out, points, width, tint) => {
    for (let k = 1; k < points.length; k++) {
      const [a, b] = [points[k - 1], points[k]];
      for (const [at, to, side] of [[a, b, 1], [a, b, -1], [b, a, -1], [b, a, -1], [b, a, 1], [a, b, 1]])
        out.push(...at, ...to, side * width, ...tint);
    }
  };
  const seen = (section, first, last) =>
    section.seen.slice(first, last + 1).every(Boolean);

  let batches = {}, quantity, ink;
  function build() {
    quantity = scene.quantities[choice.selectedIndex];
    ink = getComputedStyle(figure).color.match(/[\d.]+/g).slice(0, 3).map(v => v / 255);
    const band = [], marks = [], dots = [], ofPoints = !quantity.values;
    const tint = k => ofPoints ? [0.6, 0.6, 0.6, 0.25] : shade(quantity, quantity.values[k]);
    for (const [a, b] of scene.joined) {
      for (let k = 0; k < 4; k++) {
        const [p, q] = [sections[a].corners, sections[b].corners];
        if (!seen(sections[a], k, k + 1) || !seen(sections[b], k, k + 1)) continue;
        if (k === 1 || k === 2) {
          triangle(band, [p[k], q[k], p[k + 1]], [tint(a), tint(b), tint(a)]);
          triangle(band, [q[k], q[k + 1], p[k + 1]], [tint(b), tint(b), tint(a)]);
        }
      }
      for (let k = 0; k < 5; k++)
        if (sections[a].seen[k] && sections[b].seen[k])
          line(marks, [sections[a].corners[k], sections[b].corners[k]], k % 4 ? 1.6 : 0.8, [...ink, k % 4 ? 1 : 0.5]);
    }
    sections.forEach((section, k) => {
      for (let i = 0; i < 4 && !ofPoints; i++)
        if (seen(section, i, i + 1)) line(marks, section.corners.slice(i, i + 2), 2.2, tint(k));
    });
    for (let k = 0; k < steps.length / 3; k++) {
      const at = [0, 1, 2].map(i => scene.points.middle[i] + scene.points.unit * steps[3 * k + i]);
      dots.push(...at, 0, 0, 0, ...(ofPoints ? shade(quantity, micrometres[k] / 1e3) : [...ink, 0.35]));
    }
    batches.band = fill(batches.band, faces, gl.TRIANGLES, band);
    batches.dots = fill(batches.dots, faces, gl.POINTS, dots);
    batches.marks = fill(batches.marks, lines, gl.TRIANGLES, marks);
    const bar = figure.querySelector(".scale");
    bar.children[1].style.background = `linear-gradient(90deg, ${quantity.colours.join(",")})`;
    const digits = quantity.high - quantity.low < 10 ? 2 : 0;
    bar.children[0].textContent = quantity.low.toFixed(digits);
    bar.children[2].textContent = `${quantity.high.toFixed(digits)} ${quantity.unit}`;
    redraw();
  }
  function buildGhost() {
    const solid = [], outline = [], grey = [0.55, 0.6, 0.66];
    for (const three of scene.ghost.triangles)
      triangle(solid, three.map(k => scene.ghost.vertices[k]), Array(3).fill([...grey, 0.16]));
    for (const points of scene.ghost.lines) line(outline, points, 1, [...grey, 0.8]);
    batches.ghost = fill(null, faces, gl.TRIANGLES, solid);
    batches.outline = fill(null, lines, gl.TRIANGLES, outline);
  }

  // ---- the camera: orthographic, so that lengths are to scale; it turns about the vertical
  const bounds = points => [0, 1, 2].map(i => [Math.min(...points.map(p => p[i])), Math.max(...points.map(p => p[i]))]);
  let camera, axes, wide, tall, scale;
  function reset() {
    const shown = corners.concat(find("stations")?.checked ? scene.stations.map(one => one.at) : []);
    const middle = bounds(shown).map(([low, high]) => (low + high) / 2);
    camera = {azimuth: scene.azimuth + 0.3, height: 0.3, zoom: 1, middle};
    const first = axesOf(camera);
    const reach = axis => Math.max(...shown.map(p => Math.abs(dot(axis, minus(p, middle)))), 1);
    camera.half = [reach(first.right), reach(first.up)];
    redraw();
  }
  function axesOf({azimuth: a, height: h}) {
    const eye = [Math.cos(h) * Math.cos(a), Math.cos(h) * Math.sin(a), Math.sin(h)];
    const right = [-Math.sin(a), Math.cos(a), 0];
    return {right, up: cross(eye, right), eye};
  }
  function aim() {
    const dense = window.devicePixelRatio || 1;
    wide = canvas.clientWidth; tall = canvas.clientHeight;
    for (const one of [canvas, paper]) {
      if (one.width !== Math.round(wide * dense)) one.width = Math.round(wide * dense);
      if (one.height !== Math.round(tall * dense)) one.height = Math.round(tall * dense);
    }
    axes = axesOf(camera);
    scale = camera.zoom * 0.43 * Math.min(wide / camera.half[0], tall / camera.half[1]);
  }
  const project = p => {
    const off = minus(p, camera.middle);
    return [wide / 2 + scale * dot(axes.right, off), tall / 2 - scale * dot(axes.up, off)];
  };

  let waiting = false;
  function redraw() {
    if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; draw(); }); }
  }
  function draw() {
    aim();
    const {right, up, eye} = axes, [x, y, z] = [2 * scale / wide, 2 * scale / tall, -1 / 5000];
    const rows = [right.map(v => v * x), up.map(v => v * y), eye.map(v => v * z)];
    const view = [0, 1, 2].flatMap(i => [rows[0][i], rows[1][i], rows[2][i], 0])
      .concat(rows.map(row => -dot(row, camera.middle)), 1);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    const shown = ["band", ...(find("points").checked || !quantity.values ? ["dots"] : []), "marks",
      ...(find("ghost")?.checked ? ["outline", "ghost"] : [])];
    for (const name of shown) {
      const {buffer, kind, mode, count} = batches[name];
      gl.depthMask(name !== "ghost");
      gl.useProgram(kind.made);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      let offset = 0;
      for (const [attribute, n] of kind.layout) {
        const place = gl.getAttribLocation(kind.made, attribute);
        if (place >= 0) {
          gl.enableVertexAttribArray(place);
          gl.vertexAttribPointer(place, n, gl.FLOAT, false, 4 * kind.floats, 4 * offset);
        }
        offset += n;
      }
      const uniform = word => gl.getUniformLocation(kind.made, word);
      gl.uniformMatrix4fv(uniform("view"), false, view);
      if (kind === lines) gl.uniform2f(uniform("pixels"), wide, tall);
      else {
        gl.uniform3fv(uniform("eye"), eye);
        gl.uniform1f(uniform("size"), (quantity.values ? 1.5 : 3.5) * canvas.width / wide);
      }
      gl.drawArrays(mode, 0, count);
    }
    gl.depthMask(true);
    write();
  }

  // ---- what is written over it: numbers of sections, stations, measured distance, axes, scale
  let hovered = null, picked = [];
  const css = alpha => `rgba(${ink.map(v => Math.round(255 * v)).join(",")},${alpha})`;
  function write() {
    const dense = paper.width / wide;
    pen.setTransform(dense, 0, 0, dense, 0, 0);
    pen.clearRect(0, 0, wide, tall);
    pen.font = "12px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.textAlign = "center";
    pen.fillStyle = pen.strokeStyle = css(1);
    if (find("numbers").checked) {
      const taken = [];
      for (const section of sections) {
        const [end, near] = [project(section.corners[4]), project(section.corners[3])];
        const off = Math.hypot(end[0] - near[0], end[1] - near[1]) || 1;
        const at = end.map((v, i) => v + 11 * (v - near[i]) / off);
        const room = 7 + pen.measureText(section.label).width;
        if (taken.some(other => Math.abs(other[0] - at[0]) < room && Math.abs(other[1] - at[1]) < 15)) continue;
        taken.push(at);
        pen.fillText(section.label, ...at);
      }
      const last = sections[sections.length - 1].corners;
      pen.fillStyle = css(0.75);
      [1, 2, 3, 4, 5].forEach(k => {
        const [px, py] = project(last[k - 1]);
        if (k === 1 || k === 5 || scale > 3) pen.fillText("p" + k, px + 13, py - 9);
      });
    }
    pen.fillStyle = css(1);
    for (const one of find("stations")?.checked ? scene.stations : []) {
      const [px, py] = project(one.at);
      pen.fillRect(px - 4, py - 4, 8, 8);
      pen.fillText(one.name, px, py - 13);
    }
    if (hovered !== null) path(sections[hovered].corners, 1, []);
    for (const one of picked) { pen.beginPath(); pen.arc(...project(one.at), 6, 0, 7); pen.stroke(); }
    if (picked.length === 2) path(picked.map(one => one.at), 1.5, [6, 4]);
    // Axes, lower left, and a scale bar, lower right: an orthographic view has one.
    const foot = [40, tall - 34];
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
      const tip = [foot[0] + 24 * dot(axes.right, axis), foot[1] - 24 * dot(axes.up, axis)];
      pen.beginPath(); pen.moveTo(...foot); pen.lineTo(...tip); pen.lineWidth = 1.5; pen.stroke();
      pen.fillText("xyz"[k], foot[0] + 1.45 * (tip[0] - foot[0]), foot[1] + 1.45 * (tip[1] - foot[1]));
    });
    const most = wide / 5 / scale, power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].map(k => k * power).find(v => v <= most);
    pen.fillRect(wide - 16 - length * scale, tall - 16, length * scale, 2);
    pen.fillText(`${+length.toPrecision(1)} mm`, wide - 16 - length * scale / 2, tall - 26);
  }
  function path(points, width, dashes) {
    pen.beginPath();
    points.forEach((p, k) => k ? pen.lineTo(...project(p)) : pen.moveTo(...project(p)));
    pen.lineWidth = width; pen.setLineDash(dashes); pen.stroke(); pen.setLineDash([]);
  }

  // ---- pointing: what is under the pointer shows its values, two corners their distance
  const between = (p, a, b) => {
    const d = [b[0] - a[0], b[1] - a[1]], n = d[0] ** 2 + d[1] ** 2 || 1;
    const t = Math.min(Math.max(((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / n, 0), 1);
    return Math.hypot(p[0] - a[0] - t * d[0], p[1] - a[1] - t * d[1]);
  };
  function nearestSection(p) {
    let best = null, least = 14;
    sections.forEach((section, k) => {
      const at = section.corners.map(project);
      for (let i = 0; i < 4; i++) {
        const off = between(p, at[i], at[i + 1]);
        if (off < least) [best, least] = [k, off];
      }
    });
    return best;
  }
  function nearestCorner(p) {
    let best = null, least = 16;
    sections.forEach(section => section.corners.forEach((at, k) => {
      const q = project(at), off = Math.hypot(p[0] - q[0], p[1] - q[1]);
      if (section.seen[k] && off < least) [best, least] = [{at, name: `section ${section.name} p${k + 1}`}, off];
    }));
    return best;
  }
  function showReadout() {
    if (picked.length === 2) {
      const off = minus(picked[1].at, picked[0].at);
      const parts = off.map((v, i) => `Δ${"xyz"[i]} ${v.toFixed(2)}`).join(", ");
      readout.textContent = `${picked[0].name} to ${picked[1].name}: ${Math.hypot(...off).toFixed(2)} mm (${parts})`;
    } else if (picked.length === 1) readout.textContent = `${picked[0].name}: click another corner to measure to it`;
    else if (hovered !== null) {
      const section = sections[hovered];
      const values = scene.quantities.filter(one => one.values && one.values[hovered] !== null).map(one =>
        `${one.name} ${one.values[hovered].toFixed(2)}${one.sigmas ? ` ± ${(2 * one.sigmas[hovered]).toFixed(2)}` : ""} ${one.unit}`);
      readout.textContent = [`section ${section.name} ${section.where}`.trim(), ...values, ...section.conditions].join(", ");
    } else readout.textContent = readout.dataset.hint;
  }

  const pointers = new Map();
  let travelled = 0;
  const place = event => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
  function turn(dx, dy) {
    camera.azimuth -= dx * 0.008;
    camera.height = Math.min(Math.max(camera.height + dy * 0.008, -Math.PI / 2), Math.PI / 2);
    redraw();
  }
  function pan(dx, dy) {
    camera.middle = plus(plus(camera.middle, axes.right, -dx / scale), axes.up, dy / scale);
    redraw();
  }
  function zoom(factor) { camera.zoom = Math.min(Math.max(camera.zoom * factor, 0.05), 200); redraw(); }
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    if (pointers.size === 1) travelled = 0;
  });
  canvas.addEventListener("pointermove", event => {
    const now = place(event), before = pointers.get(event.pointerId);
    if (!before) { hovered = nearestSection(now); showReadout(); redraw(); return; }
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    travelled += Math.hypot(dx, dy);
    if (pointers.size === 2) {
      const other = [...pointers.entries()].find(([id]) => id !== event.pointerId)[1];
      const apart = p => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1);
      zoom(apart(now) / apart(before));
      pan(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) pan(dx, dy);
    else turn(dx, dy);
    pointers.set(event.pointerId, now);
  });
  const lift = event => {
    if (event.type === "pointerup" && pointers.size === 1 && travelled < 5) {
      const corner = nearestCorner(place(event));
      picked = corner ? [...(picked.length === 2 ? [] : picked), corner] : [];
      hovered = nearestSection(place(event));
      showReadout();
      redraw();
    }
    pointers.delete(event.pointerId);
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("pointerleave", () => { hovered = null; showReadout(); redraw(); });
  canvas.addEventListener("contextmenu", event => event.preventDefault());
  // The wheel scrolls the page until the view is clicked.
  canvas.addEventListener("wheel", event => {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(-0.0015 * event.deltaY));
  }, {passive: false});
  const keys = {ArrowLeft: () => turn(-20, 0), ArrowRight: () => turn(20, 0), ArrowUp: () => turn(0, -20),
    ArrowDown: () => turn(0, 20), "+": () => zoom(1.25), "-": () => zoom(0.8), Home: reset};
  canvas.addEventListener("keydown", event => {
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  });

  choice.append(...scene.quantities.map(one => new Option(one.name)));
  choice.addEventListener("change", () => { build(); showReadout(); });
  for (const name of ["points", "numbers", "ghost"]) find(name)?.addEventListener("change", redraw);
  find("stations")?.addEventListener("change", reset);
  find("reset").addEventListener("click", () => { picked = []; showReadout(); reset(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", build);
  new ResizeObserver(redraw).observe(canvas);
  canvas.addEventListener("webglcontextlost", () => figure.classList.remove("turns"));
  figure.classList.add("turns");
  if (scene.ghost) buildGhost();
  reset();
  build();
  showReadout();
})();
