"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const SVG = "http://www.w3.org/2000/svg";
  const NONE = "–";

  function element(name, attributes = {}, ...children) {
    const svg = ["svg", "g", "path", "line", "text", "rect", "circle", "title", "tspan"].includes(name);
    const made = svg ? document.createElementNS(SVG, name) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  }

  function shown(value) {
    if (value === null || value === undefined || Number.isNaN(value)) return NONE;
    if (typeof value === "string") return value;
    if (value === 0) return "0";
    const size = Math.abs(value);
    const text = size < 1e-3 || size >= 1e5 ? value.toExponential(1) : value.toPrecision(4);
    return text.replace(/^-/, "−").replace("e-", "e−");
  }

  // Names with their subscripts, and no line break inside of a norm.
  function typeset(name, inSvg = false) {
    const parts = name.replace(/‖[^‖]*‖/g, (norm) => norm.replaceAll(" ", "\u00a0")).split(/(?<![\p{L}\d_.])(\p{L}_[\p{L}\d]{1,2})(?![\p{L}\d_])/u);
    return parts.flatMap((part, i) => {
      if (i % 2 === 0) return inSvg ? [element("tspan", i ? { dy: -4 } : {}, part)] : [part];
      const [letter, index] = part.split("_");
      return inSvg
        ? [element("tspan", {}, letter), element("tspan", { dy: 4, "font-size": "75%" }, index)]
        : [letter, element("sub", {}, index)];
    });
  }

  function unitOf(column) {
    return column.unit === "mixed" ? "(mixed units)" : column.unit;
  }

  // Theme.
  $("theme").addEventListener("change", (event) => {
    const root = document.documentElement;
    if (event.target.value) root.dataset.theme = event.target.value;
    else delete root.dataset.theme;
  });

  const table = JSON.parse($("data-runs").textContent);
  const picked = $("data-curves") ? picker(JSON.parse($("data-curves").textContent)) : null;
  runTable();
  downloads();
  lawsInFigures();
  window.addEventListener("hashchange", linked);
  // What is folded cannot be opened on paper.
  window.addEventListener("beforeprint", () => {
    for (const folded of document.querySelectorAll("details.folded")) folded.open = true;
  });
  linked();

  // A link to a run: report.html#run-17.
  function linked() {
    const run = location.hash.match(/^#run-(\d+)$/);
    if (run && picked && picked.chooseRun(Number(run[1]))) $("picker").scrollIntoView();
  }

  // A law that is pointed at, in the intervals or in a figure, stands out; its button hides it.
  function lawsInFigures() {
    const rows = [...document.querySelectorAll("tr[data-law]")];
    const curves = [...document.querySelectorAll(".paper [id*='-law-']")];
    const lawOf = (part) => part.id.match(/-law-(\d+)-/)[1];
    function point(law) {
      for (const row of rows) row.classList.toggle("pointed", row.dataset.law === law);
      for (const curve of curves) curve.classList.toggle("dim", law !== null && lawOf(curve) !== law);
    }
    for (const row of rows) {
      row.addEventListener("pointerenter", () => point(row.dataset.law));
      row.addEventListener("pointerleave", () => point(null));
    }
    for (const curve of curves) {
      const row = rows.find((one) => one.dataset.law === lawOf(curve));
      if (!row) continue;
      curve.prepend(element("title", {}, row.title));
      curve.addEventListener("pointerenter", () => point(lawOf(curve)));
      curve.addEventListener("pointerleave", () => point(null));
    }
    for (const button of document.querySelectorAll("tr[data-law] button")) {
      button.addEventListener("click", () => {
        const isShown = button.getAttribute("aria-pressed") === "false";
        button.setAttribute("aria-pressed", String(isShown));
        const law = button.closest("tr").dataset.law;
        for (const curve of curves) if (lawOf(curve) === law) curve.classList.toggle("gone", !isShown);
      });
    }
  }

  // What can be kept: figures as SVG, tables as CSV, the configuration as YAML.
  function downloads() {
    for (const figure of document.querySelectorAll("figure > .paper")) {
      offer(figure.nextElementSibling, "SVG", `${figure.parentElement.id}.svg`, "image/svg+xml", () => drawing(figure.firstElementChild));
    }
    for (const data of document.querySelectorAll("table.data[id$=-table]")) {
      const name = data.id.replace(/-table$/, "");
      offer($(`${name}-caption`), "CSV", `${name}.csv`, "text/csv", () => csv([...data.rows].map(texts)));
    }
    offer($("config-caption"), "YAML", "config.yaml", "text/yaml", () => `${$("config").textContent}\n`);
  }

  function offer(beside, kind, file, type, content) {
    const button = element("button", { type: "button", class: "download", "aria-label": `Download ${file}` }, `⤓ ${kind}`);
    button.addEventListener("click", (event) => {
      event.preventDefault();
      const address = URL.createObjectURL(new Blob([content()], { type }));
      element("a", { href: address, download: file }).click();
      setTimeout(() => URL.revokeObjectURL(address), 1000);
    });
    beside.append(button);
  }

  // A figure by itself, which has a size.
  function drawing(svg) {
    const copy = svg.cloneNode(true);
    const [, , width, height] = copy.getAttribute("viewBox").split(" ");
    for (const [name, value] of Object.entries({ width: `${width}pt`, height: `${height}pt` })) {
      copy.setAttribute(name, value);
    }
    return new XMLSerializer().serializeToString(copy);
  }

  function texts(row) {
    return [...row.cells].flatMap((cell) => [cell.textContent.trim().replace(/−(?=\d)/g, "-"), ...Array(cell.colSpan - 1).fill("")]);
  }

  function csv(rows) {
    const field = (value) => {
      const text = value === null || value === undefined ? "" : String(value);
      return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
    };
    return rows.map((row) => `${row.map(field).join(",")}\r\n`).join("");
  }

  // The run picker.
  function picker(data) {
    const perRun = data.times.length;
    const panels = data.panels.map((panel) => ({ ...panel, values: decoded(panel) }));
    const visible = data.controllers.map(() => true);
    let index = 0;

    function decoded(panel) {
      const bytes = Uint8Array.from(atob(panel.codes), (c) => c.charCodeAt(0));
      const view = new DataView(bytes.buffer);
      return Float64Array.from({ length: bytes.length / 2 }, (_, i) => {
        const code = view.getUint16(2 * i, true);
        return code > data.levels ? NaN : panel.largest * (code / data.levels) ** data.power;
      });
    }

    function curve(panel, controller) {
      const start = (controller * data.runs.length + index) * perRun;
      return panel.values.subarray(start, start + perRun);
    }

    function swatch(look) {
      const line = element("line", { x1: 0, x2: 34, y1: 6, y2: 6, "stroke-width": 2.4, ...stroke(look) });
      return element("svg", { class: "swatch", width: 34, height: 12, "aria-hidden": "true" }, line);
    }

    function stroke(look) {
      const dashes = look.dashes.map((length) => length * 1.8).join(" ");
      return { class: "curve", stroke: look.colour, "stroke-dasharray": dashes || "none" };
    }

    function ticks(low, high, count) {
      const rough = (high - low) / count;
      const power = 10 ** Math.floor(Math.log10(rough));
      const step = [1, 2, 2.5, 5, 10].map((k) => k * power).find((k) => k >= rough * (1 - 1e-9));
      const found = [];
      for (let k = Math.ceil(low / step - 1e-9); k * step <= high * (1 + 1e-9); k += 1) found.push(k * step);
      return found;
    }

    function draw(panel, number) {
      const width = Math.min(460, $("panels").children[number].clientWidth || 460);  // letters keep their size
      const height = 250, left = 52, right = 12, top = 26, bottom = 36;
      const log = $("log").checked && !panel.name.startsWith("‖τ‖");
      const drawn = data.controllers.map((look, c) => [look, curve(panel, c)]).filter((_, c) => visible[c]);
      const finite = drawn.flatMap(([, y]) => Array.from(y)).filter((y) => Number.isFinite(y) && (!log || y > 0));
      let high = finite.length ? Math.max(...finite) : 1;
      let low = log && finite.length ? Math.max(Math.min(...finite), high * 1e-12) : 0;
      if (high <= low) high = low + 1;
      const [t0, t1] = [data.times[0], data.times[perRun - 1]];
      const scale = log ? Math.log10 : (y) => y;
      const [s0, s1] = log ? [Math.floor(scale(low)), Math.ceil(scale(high))] : [0, high * 1.05];
      const x = (t) => left + (width - left - right) * (t - t0) / (t1 - t0);
      const y = (v) => height - bottom - (height - top - bottom) * (scale(v) - s0) / (s1 - s0);
      const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": described(panel) });
      const unit = panel.unit ? ` (${panel.unit})` : "";
      svg.append(element("text", { x: left, y: 15, "font-weight": 600 }, ...typeset(panel.name + unit, true)));
      for (const t of ticks(t0, t1, 5)) {
        svg.append(element("line", { class: "gridline", x1: x(t), x2: x(t), y1: top, y2: height - bottom }));
        svg.append(element("text", { x: x(t), y: height - bottom + 16, "text-anchor": "middle" }, shownTick(t)));
      }
      svg.append(element("text", { x: (left + width - right) / 2, y: height - 3, "text-anchor": "middle" }, "time (s)"));
      const marks = log ? decades(s0, s1) : ticks(0, s1, 4);
      for (const v of marks) {
        svg.append(element("line", { class: "gridline", x1: left, x2: width - right, y1: y(v), y2: y(v) }));
        const text = log ? `1e${Math.round(scale(v))}`.replace("-", "−") : shownTick(v);
        svg.append(element("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, text));
      }
      svg.append(element("rect", { class: "axis", x: left, y: top, width: width - left - right, height: height - top - bottom }));
      for (const [look, values] of drawn) {
        let path = "", pen = false;
        values.forEach((v, i) => {
          const there = Number.isFinite(v) && (!log || v > 0);
          if (there) path += `${pen ? "L" : "M"}${x(data.times[i]).toFixed(1)} ${y(v).toFixed(1)}`;
          pen = there;
        });
        svg.append(element("path", { d: path, ...stroke(look) }, element("title", {}, look.title)));
      }
      svg.addEventListener("pointermove", (event) => pointed(event, svg, { x, y, left, right, width, t0, t1, log }));
      svg.addEventListener("pointerleave", () => svg.querySelectorAll(".cursor").forEach((e) => e.remove()));
      svg.drawn = drawn;
      $("panels").children[number].replaceChildren(svg);
    }

    function decades(s0, s1) {
      const step = Math.ceil((s1 - s0) / 6);
      const found = [];
      for (let k = s0; k <= s1; k += step) found.push(10 ** k);
      return found;
    }

    function shownTick(v) {
      return String(Number(v.toPrecision(6))).replace("-", "−");
    }

    function pointed(event, svg, axes) {
      svg.querySelectorAll(".cursor").forEach((e) => e.remove());
      const box = svg.getBoundingClientRect();
      const at = (event.clientX - box.left) / box.width * axes.width;
      const share = (at - axes.left) / (axes.width - axes.left - axes.right);
      if (share < 0 || share > 1) return;
      const i = Math.round(share * (perRun - 1));
      const lines = [];
      for (const [look, values] of svg.drawn) {
        lines.push(`${look.title.replace(/^(.{23}).{2,}/u, "$1…")} ${shown(values[i])}`);
        if (!Number.isFinite(values[i]) || (axes.log && values[i] <= 0)) continue;
        const place = { cx: axes.x(data.times[i]), cy: axes.y(values[i]), r: 3.2 };
        svg.append(element("circle", { class: "cursor", ...place, fill: look.colour }));
      }
      const text = `t = ${shownTick(data.times[i])} s:  ${lines.join("   ")}`;
      svg.append(element("text", { class: "cursor", x: axes.width - axes.right, y: 15, "text-anchor": "end" }, text));
    }

    function described(panel) {
      const parts = data.controllers.map((look, c) => {
        const values = curve(panel, c);
        return `${look.title} from ${shown(values[0])} to ${shown(values[perRun - 1])}`;
      });
      return `${panel.name} over time in run ${data.runs[index]}: ${parts.filter((_, c) => visible[c]).join(", ")}`;
    }

    function summarised() {
      const run = data.runs[index];
      const rows = table.rows.filter((row) => row[1] === run);
      const settling = table.columns.findIndex((column) => column.metric === "settling_time");
      const early = table.columns.findIndex((column) => column.metric === "early_torque");
      const parts = rows.map((row) => {
        const words = [];
        if (row[2] !== "ok") words.push(row[2]);
        if (early >= 0) words.push(`mean torque in the first 5 s ${shown(row[3 + early])} ${unitOf(table.columns[early])}`);
        if (settling >= 0) words.push(row[3 + settling] === null ? "not settled" : `settled at ${shown(row[3 + settling])} s`);
        return `${table.controllers[row[0]]}: ${words.join(", ")}`;
      });
      return `Run ${run}. ${parts.join("; ")}.`;
    }

    function redraw() {
      panels.forEach(draw);
      $("run").value = data.runs[index];
      $("slider").value = index;
      $("slider").setAttribute("aria-valuetext", `run ${data.runs[index]}`);
      $("run-name").textContent = data.runs[index];
      $("run-to-animate").textContent = data.runs[index];
      $("previous").disabled = index === 0;
      $("next").disabled = index === data.runs.length - 1;
      $("run-summary").textContent = summarised();
      $("run-link").setAttribute("href", `#run-${data.runs[index]}`);
    }

    // The runs of a controller with a value that the page can draw, the best first.
    function ranked(controller, column) {
      const sign = table.columns[column].better === "higher" ? -1 : 1;
      const value = (row) => row[3 + column];
      return table.rows
        .filter((row) => row[0] === controller && value(row) !== null && data.runs.includes(row[1]))
        .sort((a, b) => sign * (value(a) - value(b)));
    }

    function goTo(rank) {
      const rows = ranked(Number($("rank-controller").value), Number($("rank-column").value));
      if (!rows.length) return;
      const place = { best: 0, median: Math.floor((rows.length - 1) / 2), worst: rows.length - 1 };
      chooseRun(rows[place[rank]][1]);
    }

    function choose(position) {
      index = Math.min(Math.max(position, 0), data.runs.length - 1);
      redraw();
    }

    function chooseRun(run) {
      const position = data.runs.indexOf(run);
      if (position < 0) return false;
      choose(position);
      return true;
    }

    panels.forEach((_, number) => $("panels").append(element("div", { class: "panel", "data-panel": number })));
    window.addEventListener("resize", () => panels.forEach(draw));
    data.controllers.forEach((look, c) => {
      const box = element("input", { type: "checkbox", checked: "", value: c });
      box.addEventListener("change", () => { visible[c] = box.checked; redraw(); });
      $("shown").append(element("label", {}, box, " ", swatch(look), element("bdi", {}, look.title)));
    });
    for (const form of ["pick", "extremes"]) $(form).addEventListener("submit", (event) => event.preventDefault());
    for (const button of document.querySelectorAll("[data-rank]")) button.addEventListener("click", () => goTo(button.dataset.rank));
    $("previous").addEventListener("click", () => choose(index - 1));
    $("next").addEventListener("click", () => choose(index + 1));
    $("slider").addEventListener("input", (event) => choose(Number(event.target.value)));
    $("run").addEventListener("change", (event) => { if (!chooseRun(Number(event.target.value))) redraw(); });
    $("log").addEventListener("change", redraw);
    redraw();
    return { chooseRun, has: (run) => data.runs.includes(run) };
  }

  // The table of all runs.
  function runTable() {
    const rowsPerPage = 25;
    const columns = [
      { name: "law", unit: "" }, { name: table.item, unit: "" }, { name: "status", unit: "" }, ...table.columns,
    ];
    let sorted = { column: null, descending: false }, page = 0, kept = table.rows;
    const head = document.querySelector("#all thead tr");
    const body = document.querySelector("#all tbody");
    $("all").style.setProperty("--columns", columns.length);

    columns.forEach((column, c) => {
      const button = element("button", { type: "button" }, ...typeset(column.name));
      button.addEventListener("click", () => {
        sorted = { column: c, descending: sorted.column === c && !sorted.descending };
        refresh();
      });
      const cell = element("th", { scope: "col", class: c === 1 || c > 2 ? "number" : "" }, button);
      if (column.unit) cell.append(element("span", { class: "unit" }, column.unit.replaceAll("^2", "²")));
      head.append(cell);
    });
    for (const status of [...new Set(table.rows.map((row) => row[2]))].sort()) {
      $("by-status").append(element("option", { value: status }, status));
    }

    function wantedRuns(text) {
      const spans = text.split(/[,;\s]+/).filter(Boolean).map((part) => {
        const match = part.match(/^(\d+)(?:[-–](\d+))?$/);
        return match ? [Number(match[1]), Number(match[2] ?? match[1])] : null;
      });
      if (!spans.length || spans.includes(null)) return null;
      return (run) => spans.some(([low, high]) => low <= run && run <= high);
    }

    function keep() {
      const controller = $("by-controller").value, status = $("by-status").value;
      const column = $("by-column").value, relation = $("by-relation").value;
      const limit = $("by-limit").value === "" ? null : Number($("by-limit").value);
      const runs = wantedRuns($("by-run").value);
      $("by-run").setAttribute("aria-invalid", String($("by-run").value.trim() !== "" && !runs));
      $("by-limit").disabled = relation === "missing";
      return table.rows.filter((row) => {
        if (controller !== "" && row[0] !== Number(controller)) return false;
        if (status !== "" && row[2] !== status) return false;
        if (runs && !runs(row[1])) return false;
        if (column === "") return true;
        const value = row[3 + Number(column)];
        if (relation === "missing") return value === null;
        if (limit === null) return true;
        return value !== null && (relation === "above" ? value > limit : value < limit);
      });
    }

    function refresh() {
      kept = keep();
      const { column, descending } = sorted;
      if (column !== null) {
        const sign = descending ? -1 : 1;
        kept = [...kept].sort((a, b) => {
          const [u, v] = [a[column], b[column]];
          if (u === v) return 0;
          if (u === null || v === null) return u === null ? 1 : -1;  // no value: last, either way
          return sign * (u < v ? -1 : 1);
        });
      }
      [...head.children].forEach((cell, c) => {
        cell.setAttribute("aria-sort", c !== column ? "none" : descending ? "descending" : "ascending");
      });
      page = 0;
      render();
    }

    function render() {
      const pages = Math.max(1, Math.ceil(kept.length / rowsPerPage));
      page = Math.min(Math.max(page, 0), pages - 1);
      body.replaceChildren(...kept.slice(page * rowsPerPage, (page + 1) * rowsPerPage).map(line));
      $("count").textContent = `${kept.length} of ${table.rows.length} rows`;
      $("page").textContent = `page ${page + 1} of ${pages}`;
      $("back").disabled = page === 0;
      $("forth").disabled = page === pages - 1;
    }

    function line(row) {
      const [controller, run, status, ...numbers] = row;
      const message = table.messages[`${controller}-${run}`];
      const made = element("tr", status === "ok" ? {} : { class: "failed" });
      const title = table.controllers[controller];
      made.append(element("th", { scope: "row", class: title.length > 40 ? "long" : "" }, title));
      made.append(element("td", { class: "number" }, runLink(run)));
      made.append(element("td", { class: "status" }, message ? `${status}: ${message}` : status));
      numbers.forEach((value, c) => {
        const text = table.columns[c].given ? String(value).replace(/^-/, "−") : shown(value);
        made.append(element("td", { class: "number" }, text));
      });
      return made;
    }

    function runLink(run) {
      if (!picked || !picked.has(run)) return String(run);
      const button = element("button", { type: "button", "aria-label": `draw run ${run}` }, String(run));
      button.addEventListener("click", () => {
        picked.chooseRun(run);
        $("picker").scrollIntoView();
        $("run").focus({ preventScroll: true });
      });
      return button;
    }

    $("filters").addEventListener("submit", (event) => event.preventDefault());
    $("filters").addEventListener("input", refresh);
    $("filters").addEventListener("change", refresh);
    $("filters").addEventListener("reset", () => setTimeout(refresh));
    $("back").addEventListener("click", () => { page -= 1; render(); });
    $("forth").addEventListener("click", () => { page += 1; render(); });
    offer($("all-caption"), "CSV", `${table.item}s.csv`, "text/csv", () => csv([
      columns.map((column) => (column.unit ? `${column.name} (${column.unit})` : column.name)),
      ...kept.map((row) => [table.labels[row[0]], ...row.slice(1)]),
    ]));
    refresh();
  }
})();
