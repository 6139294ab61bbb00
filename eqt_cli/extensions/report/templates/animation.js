"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const SVG = "http://www.w3.org/2000/svg";
  const data = JSON.parse($("data").textContent);
  const last = data.times.length - 1;
  const duration = data.times[last] - data.times[0];
  const SIZE = 240, LIGHT = unit([0.35, 0.25, 0.9]);
  let view = [...data.view], now = 0, playing = false, before = null;

  function element(name, attributes = {}, ...children) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  }

  function unit(v) {
    const size = Math.hypot(...v);
    return v.map((x) => x / size);
  }

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const turned = (r, v) => [0, 3, 6].map((i) => r[i] * v[0] + r[i + 1] * v[1] + r[i + 2] * v[2]);

  // The camera: rows to the right, up, and towards the eye.
  function camera() {
    const [azimuth, elevation] = view;
    const towards = [Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation)];
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
    return [right, cross(towards, right), towards];
  }

  // A pose between two samples; null where the run had failed.
  function pose(course, position) {
    const i = Math.min(Math.floor(position), last), j = Math.min(i + 1, last), s = position - i;
    const between = (a, b) => a.map((x, k) => (1 - s) * x + s * b[k]);
    if (course.rotation[i].includes(null) || course.rotation[j].includes(null)) return null;
    const place = data.moves ? between(course.position[i], course.position[j]) : [0, 0, 0];
    return { rotation: between(course.rotation[i], course.rotation[j]), place };
  }

  // An entry of a list between two samples.
  function between(list, position) {
    const i = Math.min(Math.floor(position), last), j = Math.min(i + 1, last), s = position - i;
    return list[i].map((x, k) => (1 - s) * x + s * list[j][k]);
  }

  function drawBody(svg, c) {
    const eye = camera(), look = data.controllers[c];
    const scale = SIZE / 2 / data.reach;
    const at = (v) => {
      const w = v.map((x, k) => x - data.centre[k]);
      return [SIZE / 2 + scale * dot(eye[0], w), SIZE / 2 - scale * dot(eye[1], w)];
    };
    const parts = [];
    const line = (points) => points.map((p, k) => `${k ? "L" : "M"}${p[0].toFixed(1)} ${p[1].toFixed(1)}`).join("");
    parts.push(element("path", { class: "ground", d: data.ground.map((ends) => line(ends.map(at))).join("") }));
    if (data.moves) {
      parts.push(element("path", { class: "trail target", d: line(data.reference.position.map(at)) }));
      const course = data.bodies[c].position.filter((place) => !place.includes(null));
      parts.push(element("path", { class: "trail course", stroke: look.colour, d: line(course.map(at)) }));
    }
    const first = data.times.findIndex((t) => t >= data.times[Math.floor(now)] - data.trail);
    const past = [];
    for (let k = first; k <= Math.floor(now); k += 1) {
      const found = pose(data.bodies[c], k);
      if (found) past.push(data.moves ? found.place : turned(found.rotation, [data.length, 0, 0]));
    }
    parts.push(element("path", { class: "trail", stroke: look.colour, d: line(past.map(at)) }));

    // A block with its axes: the body in colour, the target as its ghost.
    function block(found, paint, ghost) {
      for (const polygon of data.rotors) {
        const outline = polygon.map((v) => at(turned(found.rotation, v).map((x, i) => found.place[i] + data.length * x)));
        parts.push(element("path", { d: line(outline) + "Z", fill: ghost ? "none" : paint, "fill-opacity": 0.25, stroke: paint }));
      }
      const corners = data.corners.map((v) => turned(found.rotation, v));
      for (const face of data.rotors.length ? [] : data.faces) {
        const [a, b, , d] = face.map((k) => corners[k]);
        const middle = face.reduce((sum, k) => sum.map((x, i) => x + corners[k][i] / 4), [0, 0, 0]);
        let normal = unit(cross(b.map((x, i) => x - a[i]), d.map((x, i) => x - a[i])));
        if (dot(normal, middle) < 0) normal = normal.map((x) => -x);
        if (dot(normal, eye[2]) <= 0) continue;
        const outline = face.map((k) => at(corners[k].map((x, i) => found.place[i] + data.length * x)));
        const opacity = 0.65 - 0.5 * (1 + dot(normal, LIGHT)) / 2;
        parts.push(element("path", { d: line(outline) + "Z", fill: "var(--raised)", "fill-opacity": 0.75 }));
        parts.push(element("path", { d: line(outline) + "Z", fill: paint, "fill-opacity": opacity.toFixed(2), stroke: paint }));
      }
      Object.entries(data.axes).forEach(([name, colour], k) => {
        const direction = turned(found.rotation, [0, 1, 2].map((i) => Number(i === k)));
        const end = (share) => at(found.place.map((x, i) => x + share * data.length * direction[i]));
        const drawn = ghost ? { class: "reference" } : { class: "axis-of-body", stroke: colour };
        parts.push(element("path", { d: line([at(found.place), end(1)]), ...drawn }));
        const [x, y] = end(1.14);
        const named = ghost ? { class: "reference-name" } : { class: "axis-name", fill: colour };
        parts.push(element("text", { x: x.toFixed(1), y: y.toFixed(1), ...named }, name));
      });
    }
    block(pose(data.reference, now), "var(--soft)", true);
    const body = pose(data.bodies[c], now);
    if (body) {
      block(body, look.colour, false);
      const [x, y] = at(body.place);
      parts.push(element("text", { class: "law", x: x.toFixed(1), y: (y - 1.35 * scale * data.length).toFixed(1), fill: look.colour }, look.title));
    }
    const lines = body ? between(data.thrusts[c], now) : []; // six numbers of each thruster
    for (let k = 0; k < lines.length; k += 6) {
      const [foot, tip] = [0, 3].map((i) => {
        const v = turned(body.rotation, lines.slice(k + i, k + i + 3));
        return at(body.place.map((x, j) => x + data.length * v[j]));
      });
      parts.push(element("path", { class: "arm", stroke: look.colour, d: line([at(body.place), foot]) }));
      parts.push(element("circle", { class: "rotor", cx: foot[0].toFixed(1), cy: foot[1].toFixed(1), r: 3 }));
      parts.push(element("path", { class: "thrust", d: line([foot, tip]) }));
    }
    if (!body) parts.push(element("text", { x: SIZE / 2, y: SIZE - 8, "text-anchor": "middle", fill: look.colour }, "run failed"));

    // The directions of the inertial frame, in a corner.
    data.inertial.forEach(([name, axis]) => {
      const [x, y] = [dot(eye[0], axis), -dot(eye[1], axis)], corner = [30, SIZE - 28];
      parts.push(element("path", { class: "inertial", d: line([corner, [corner[0] + 20 * x, corner[1] + 20 * y]]) }));
      parts.push(element("text", { class: "inertial-name", x: corner[0] + 29 * x, y: corner[1] + 29 * y }, name));
    });
    svg.replaceChildren(...parts);
  }

  // Curves that grow.
  const WIDTH = 460, HEIGHT = 210, LEFT = 48, RIGHT = 12, TOP = 26, BOTTOM = 36;

  function ticks(high, count) {
    const power = 10 ** Math.floor(Math.log10(high / count));
    const step = [1, 2, 2.5, 5, 10].map((k) => k * power).find((k) => k >= high / count * (1 - 1e-9));
    return Array.from({ length: Math.floor(high / step + 1e-9) + 1 }, (_, k) => Number((k * step).toPrecision(6)));
  }

  function panel(it) {
    const numbers = it.curves.flat().filter((v) => v !== null);
    const high = 1.05 * (Math.max(...numbers, 0) || 1);
    const x = (t) => LEFT + (WIDTH - LEFT - RIGHT) * (t - data.times[0]) / duration;
    const y = (v) => HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * v / high;
    const svg = element("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${it.name} over time` });
    const unitText = it.unit ? ` (${it.unit})` : "";
    svg.append(element("text", { x: LEFT, y: 15, "font-weight": 600 }, ...typeset(it.name + unitText)));
    for (const t of ticks(duration, 5)) {
      svg.append(element("line", { class: "gridline", x1: x(t), x2: x(t), y1: TOP, y2: HEIGHT - BOTTOM }));
      svg.append(element("text", { x: x(t), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, String(t)));
    }
    for (const v of ticks(high, 4)) {
      svg.append(element("line", { class: "gridline", x1: LEFT, x2: WIDTH - RIGHT, y1: y(v), y2: y(v) }));
      svg.append(element("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, String(v)));
    }
    svg.append(element("text", { x: (LEFT + WIDTH - RIGHT) / 2, y: HEIGHT - 3, "text-anchor": "middle" }, "time (s)"));
    svg.append(element("rect", { class: "axis", x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM }));
    const path = (curve, end) => {
      let text = "", pen = false;
      for (let i = 0; i <= end; i += 1) {
        if (curve[i] !== null) text += `${pen ? "L" : "M"}${x(data.times[i]).toFixed(1)} ${y(curve[i]).toFixed(1)}`;
        pen = curve[i] !== null;
      }
      return text;
    };
    const grown = it.curves.map((curve, c) => {
      const look = data.controllers[c], dashes = look.dashes.map((k) => k * 1.8).join(" ") || "none";
      svg.append(element("path", { class: "curve later", stroke: look.colour, d: path(curve, last) }));
      const made = element("path", { class: "curve", stroke: look.colour, "stroke-dasharray": dashes });
      svg.append(made);
      return made;
    });
    const cursor = element("line", { class: "now", y1: TOP, y2: HEIGHT - BOTTOM });
    svg.append(cursor);
    const box = document.createElement("div");
    box.className = "panel";
    box.append(svg);
    $("panels").append(box);
    return () => {
      const t = data.times[0] + duration * now / last;
      cursor.setAttribute("x1", x(t));
      cursor.setAttribute("x2", x(t));
      grown.forEach((made, c) => made.setAttribute("d", path(it.curves[c], Math.floor(now))));
    };
  }

  function typeset(name) {
    return name.split(/([A-Za-zωθ]_[A-Za-z])/).flatMap((part, i) => {
      if (i % 2 === 0) return [element("tspan", i ? { dy: -4 } : {}, part)];
      const [letter, index] = part.split("_");
      return [element("tspan", {}, letter), element("tspan", { dy: 4, "font-size": "75%" }, index)];
    });
  }

  const bodies = data.controllers.map((look, c) => {
    const svg = element("svg", { viewBox: `0 0 ${SIZE} ${SIZE}`, role: "img", tabindex: 0, "aria-label": `Body under ${look.title} and the reference frame` });
    const box = document.createElement("figure");
    box.append(svg);
    $("bodies").append(box);
    let held = null;
    svg.addEventListener("pointerdown", (event) => { held = [event.clientX, event.clientY]; svg.setPointerCapture(event.pointerId); });
    svg.addEventListener("pointermove", (event) => {
      if (!held) return;
      turn((held[0] - event.clientX) / 90, (event.clientY - held[1]) / 90);
      held = [event.clientX, event.clientY];
    });
    svg.addEventListener("pointerup", () => { held = null; });
    svg.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
      if (!step) return;
      event.preventDefault();
      turn(...step);
    });
    return svg;
  });
  const curves = data.panels.map(panel);

  function turn(azimuth, elevation) {
    view = [view[0] + azimuth, Math.min(Math.max(view[1] + elevation, -1.55), 1.55)];
    bodies.forEach(drawBody);
  }

  for (const look of [...data.controllers, { title: "reference", colour: "var(--soft)", dashes: [3, 2] }]) {
    const sample = element("svg", { viewBox: "0 0 36 8", "aria-hidden": "true" });
    const dashes = look.dashes.map((k) => k * 1.8).join(" ") || "none";
    sample.append(element("path", { class: "curve", stroke: look.colour, "stroke-dasharray": dashes, d: "M0 4L36 4" }));
    const item = document.createElement("li");
    item.append(sample, look.title);
    $("legend").append(item);
  }

  $("bodies").style.setProperty("--columns", data.columns);

  function show(position) {
    now = Math.min(Math.max(position, 0), last);
    const t = data.times[0] + duration * now / last;
    $("time").value = Math.round(1000 * now / last);
    $("time").setAttribute("aria-valuetext", `${t.toFixed(1)} seconds`);
    $("clock").textContent = `t = ${t.toFixed(2)} s`;
    bodies.forEach(drawBody);
    curves.forEach((draw) => draw());
  }

  function told() {
    const i = Math.floor(now);
    const words = data.controllers.map((look, c) => {
      const numbers = data.panels.map((it) => `${it.name} ${it.curves[c][i] ?? "none"} ${it.unit ?? ""}`.trim());
      return `${look.title}: ${numbers.join(", ")}`;
    });
    $("state").textContent = `At ${data.times[i].toFixed(2)} s: ${words.join("; ")}.`;
  }

  function play(on) {
    playing = on;
    before = null;
    if (on && now >= last) show(0);
    $("play").textContent = on ? "❚❚ Pause" : "▶ Play";
    $("play").setAttribute("aria-pressed", String(on));
    if (on) requestAnimationFrame(step);
    else told();
  }

  function step(instant) {
    if (!playing) return;
    if (before !== null) show(now + (instant - before) / 1000 * Number($("speed").value) * last / duration);
    before = instant;
    if (now >= last) play(false);
    else requestAnimationFrame(step);
  }

  document.querySelector("form").addEventListener("submit", (event) => event.preventDefault());
  $("play").addEventListener("click", () => play(!playing));
  $("time").addEventListener("input", (event) => { show(Number(event.target.value) / 1000 * last); if (!playing) told(); });
  $("reset").addEventListener("click", () => { view = [...data.view]; bodies.forEach(drawBody); });
  $("theme").addEventListener("change", (event) => {
    if (event.target.value) document.documentElement.dataset.theme = event.target.value;
    else delete document.documentElement.dataset.theme;
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || ["BUTTON", "SELECT", "INPUT"].includes(event.target.tagName)) return;
    event.preventDefault();
    play(!playing);
  });
  show(data.worst);
  told();

  // It starts when it is seen for the first time, unless the reader wants no motion.
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches && "IntersectionObserver" in window) {
    const observer = new IntersectionObserver((entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      observer.disconnect();
      show(0);
      play(true);
    }, { threshold: 0.3 });
    observer.observe(document.querySelector(".stage"));
  }
})();
