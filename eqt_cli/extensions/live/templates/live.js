"use strict";
// The page around compute.js: sliders, table, curves and bodies. Everything from the data is text.

(() => {
  /**
   * @typedef {{ label: string, title: string, colour: string, dashes: number[] }} Law
   * @typedef {{ metric: string, name: string, unit: string, better: string, counts: boolean }} Column
   * @typedef {{ rotation: number[][], position: number[], frame: number[][], length: number,
   *   centre: number[], reach: number, ground: number[][][], inertial: [string, number[]][],
   *   view: number[], corners: number[][], faces: number[][], rotors: number[][][] }} Scene
   * @typedef {{ id: number, setting: Record<string, number>, runs: number[], whole: boolean, before?: boolean }} Job
   * @typedef {{ numbers: Float64Array, kept: Float64Array[], ms: number } & Job} Answer
   */

  /** @param {string} id @returns {any} */
  const $ = (id) => document.getElementById(`live-${id}`);
  const SVG = "http://www.w3.org/2000/svg";
  /** @type {Omit<Live, "laws" | "columns"> & { laws: Law[], columns: Column[], panels: Column[], times: number[], engine: string,
   *   command: string, scene: Scene | null, body: { matrix: number[][], keys: Record<string, number> } | null }} */
  const data = JSON.parse($("data").textContent);
  const { laws, columns, times, scene } = data;
  const last = times.length - 1,
    END = 3,
    width = columns.length + END;
  const OUTCOMES = ["", "too many steps", "not finite", "no step is short enough", "switches without end", "stopped"];
  const SAME = 1e-6; // the largest relative difference of numbers that still are the result's

  /** @type {Record<string, number>} */
  const setting = {};
  const configured = () => Object.fromEntries(data.keys.map((key) => [key.key, key.values[key.base]]));
  /** The value of a key as a configuration has it. @param {any} key */
  const valued = (key) => setting[key.key] + (key.unit && ` ${key.unit}`);
  /** Text before a unit, where there is one. @param {string} before @param {string} unit */
  const inUnit = (before, unit) => (unit ? `${before}${unit}` : "");
  const hidden = new Set();

  /** @param {string} name @param {Record<string, any>} attributes @param {...(Node | string)} children */
  function element(name, attributes = {}, ...children) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
    made.append(...children);
    return made;
  }

  /** @param {string} name @param {Record<string, any>} attributes @param {...(Node | string)} children @returns {any} */
  function html(name, attributes = {}, ...children) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
    made.append(...children);
    return made;
  }

  /** @param {Law} law */
  const dashes = (law) => law.dashes.map((k) => k * 1.8).join(" ") || "none";
  /** The line of a law in the curves. @param {Law} law */
  const swatch = (law) =>
    element(
      "svg",
      { class: "swatch", viewBox: "0 0 30 8", "aria-hidden": "true" },
      element("path", { d: "M0 4H30", stroke: law.colour, "stroke-width": 2.5, "stroke-dasharray": dashes(law) }),
    );
  /** The name of a law, which may be long or run from right to left. @param {Law} law */
  const named = (law) => html("bdi", { class: "name", title: law.title }, law.title);
  /** The pieces of a name with its indices, as Q_E. @param {string} name @param {(index: string) => Node} below */
  const typeset = (name, below) => name.split(/_(\p{L}+)/u).map((piece, k) => (k % 2 ? below(piece) : piece));
  /** @param {number} x */
  const written = (x) => (Number.isFinite(x) ? String(Number(x.toPrecision(4))) : "–").replace("-", "−");

  // Sliders ---------------------------------------------------------------------------------------

  /** @type {Record<string, (value: number) => void>} */
  const fields = {};
  /** @type {Record<string, HTMLElement>} */
  const groups = {};
  data.keys.forEach((key, k) => {
    const [group, ...rest] = key.key.split(/(?<=^\w+)(?=[.[])/);
    const ofLaw = (/** @type {string} */ whole, /** @type {string} */ at) =>
      group === "controllers" && laws[Number(at)] ? `${laws[Number(at)].title}: ` : whole;
    const name = rest
      .join("")
      .replace(/^\./, "")
      .replace(/^\[(\d+)\]\.?/, ofLaw)
      .replace(
        /^(\[\d+\])+$/,
        (places) => `entry ${(places.match(/\d+/g) ?? []).map((k) => Number(k) + 1).join(", ")}`,
      );
    groups[group] ??= $("sliders").appendChild(html("fieldset", {}, html("legend", {}, group)));
    const label = html(
      "label",
      { for: `live-key${k}`, title: key.key },
      (name || key.key) + (key.shown ? ` (${key.shown})` : ""),
    );
    const range = html("input", { type: "range", id: `live-key${k}`, min: 0, max: key.values.length - 1, step: 1 });
    const box = html("input", {
      type: "number",
      step: "any",
      "aria-label": `${key.key}, as a number${inUnit(" in ", key.shown)}`,
      min: key.values[0],
      max: key.values[key.values.length - 1],
    });
    const note = html("span", { class: "nearest", role: "status" });
    fields[key.key] = (value) => {
      const nearest = key.values.reduce(
        (best, x, i) => (Math.abs(x - value) < Math.abs(key.values[best] - value) ? i : best),
        0,
      );
      setting[key.key] = key.values[nearest];
      note.textContent = setting[key.key] === value ? "" : `nearest to ${value}: ${setting[key.key]}`;
      range.value = nearest;
      box.value = setting[key.key];
      range.setAttribute("aria-valuetext", `${key.key} ${setting[key.key]}${inUnit(" ", key.shown)}`);
    };
    range.addEventListener("input", () => {
      fields[key.key](key.values[Number(range.value)]);
      moved();
    });
    box.addEventListener("change", () => {
      const value = Number(box.value);
      fields[key.key](box.value !== "" && Number.isFinite(value) ? value : setting[key.key]);
      moved();
    });
    fields[key.key](key.values[key.base]);
    groups[group].append(html("div", { class: "row" }, label, range, box, note));
  });
  const reset = html("button", { type: "button" }, "As configured");
  reset.addEventListener("click", () => {
    for (const [key, value] of Object.entries(configured())) fields[key](value);
    moved();
  });
  $("sliders").append(reset);
  $("sliders").addEventListener("submit", (/** @type {Event} */ event) => event.preventDefault());

  function fromFragment() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    for (const [key, value] of Object.entries(configured())) {
      const text = wanted.get(key),
        number = Number(text);
      fields[key](value);
      if (text && Number.isFinite(number)) fields[key](number);
    }
    const run = Number(wanted.get("run"));
    if (Number.isInteger(run) && run >= 0 && run < data.runs) $("run").value = String(run);
  }

  // Workers: the run on show first, then all runs, a few at a time -------------------------------

  /** @type {{ worker: Worker, busy: boolean }[]} */
  const workers = [];
  let id = 0,
    fused = true,
    ready = 0,
    share = 4,
    checked = false,
    told = 0;
  /** What eqt computed. @type {{ expected: Float64Array, status: Float64Array }} */
  let stored;
  /** @type {Job[]} */
  let queue = [];
  /** @type {Answer | null} */
  let shown = null;
  /** @type {Answer | null} */
  let first = null;
  /** @type {Float64Array} */
  let all = new Float64Array(0);
  let done = 0,
    spent = 0;
  /** @type {Float64Array | null} */
  let base = null;

  /** @param {boolean} mayFuse */
  function start(mayFuse) {
    const source = URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" }));
    const count = Math.max(1, Math.min(4, (navigator.hardwareConcurrency || 2) - 1));
    for (let k = 0; k < count; k += 1) {
      const worker = begun(source);
      if (!worker) return;
      const entry = { worker, busy: true };
      worker.onmessage = ({ data: answer }) => received(entry, answer);
      worker.onerror = (event) => broken(event.message || BLOCKED);
      worker.postMessage({ load: data, mayFuse });
      workers.push(entry);
    }
  }

  const BLOCKED = "its server's Content-Security-Policy blocks workers (worker-src blob: allows them)";

  /** @param {string} source */
  function begun(source) {
    try {
      return new Worker(source);
    } catch (error) {
      broken(error instanceof Error && error.name !== "SecurityError" ? error.message : BLOCKED);
      return null;
    }
  }

  /** @param {string} why */
  function broken(why) {
    $("all").classList.remove("stale");
    $("check").textContent =
      `This browser cannot run the compiled program: ${why}. The table has the configured numbers.`;
    $("check").className = "check bad";
  }

  /** @param {{ worker: Worker, busy: boolean }} entry @param {any} answer */
  function received(entry, answer) {
    entry.busy = false;
    if (answer.failed) return broken(answer.failed);
    if (answer.ready) {
      fused &&= answer.fused;
      stored = answer;
      ready += 1;
      if (ready === 1) compute();
    } else if (answer.id === id) {
      if (answer.whole) show(answer);
      else gather(answer);
    }
    dispatch();
    return undefined;
  }

  function dispatch() {
    for (const entry of workers) {
      const job = entry.busy ? undefined : queue.shift();
      if (job) {
        entry.busy = true;
        entry.worker.postMessage(job);
      }
    }
  }

  /** Asks for all runs of a setting; what was asked before is forgotten. */
  function compute() {
    id += 1;
    $("all").classList.add("stale");
    const now = base ? { ...setting } : configured(),
      run = Number($("run").value);
    all = new Float64Array(laws.length * data.runs * width);
    done = spent = 0;
    queue = [{ id, setting: { ...setting }, runs: [run], whole: true }];
    // A page that is opened by a link has not seen the run as it is configured.
    if (changed().length && first?.runs[0] !== run)
      queue.push({ id, setting: configured(), runs: [run], whole: true, before: true });
    for (let begin = 0; begin < data.runs; begin += share) {
      const runs = Array.from({ length: Math.min(share, data.runs - begin) }, (_, k) => begin + k);
      queue.push({ id, setting: now, runs, whole: false });
    }
    dispatch();
  }

  /** @param {Answer} answer */
  function gather({ runs, numbers, ms }) {
    laws.forEach((_, law) =>
      runs.forEach((run, k) => {
        const row = numbers.subarray((law * runs.length + k) * width, (law * runs.length + k + 1) * width);
        all.set(row, (law * data.runs + run) * width);
      }),
    );
    done += runs.length;
    spent += ms;
    share = Math.max(1, Math.min(64, Math.round((runs.length * 30) / Math.max(ms, 1))));
    $("progress").textContent = done < data.runs ? `${done} of ${data.runs} runs …` : "";
    if (done < data.runs) return;
    if (base) {
      table();
      return;
    }
    base = all.slice();
    check(base);
    table();
    if (changed().length) compute();
  }

  const changed = () => data.keys.filter((key) => setting[key.key] !== key.values[key.base]);

  const commanded = () =>
    data.command +
    changed()
      .map((key) => ` --set '${key.key}=${valued(key)}'`)
      .join("");

  /** Shows the command, in words that no browser breaks at a hyphen. */
  function showCommand() {
    const span = (/** @type {string} */ word) => {
      const node = document.createElement("span");
      node.textContent = word;
      return node;
    };
    const words = commanded().split(" ").map(span);
    $("command").replaceChildren(...words.flatMap((word, k) => (k ? [" ", word] : [word])));
  }

  /** Says so where no rigid body has the inertia: tr(J)/2 − J, of squared distances, is not ≥ 0. */
  function judgeBody() {
    if (!data.body) return;
    const J = data.body.matrix.map((row) => [...row]);
    for (const [key, place] of Object.entries(data.body.keys)) J[place][place] = setting[key];
    const half = (J[0][0] + J[1][1] + J[2][2]) / 2;
    const A = J.map((row, i) => row.map((x, j) => ((i === j ? half : 0) - x) / half));
    const minor = (/** @type {number} */ i, /** @type {number} */ j) => A[i][i] * A[j][j] - A[i][j] * A[j][i];
    const whole = [0, 1, 2].map((j) => {
      const [k, l] = [(j + 1) % 3, (j + 2) % 3];
      return A[0][j] * (A[1][k] * A[2][l] - A[1][l] * A[2][k]);
    });
    const minors = [A[0][0], A[1][1], A[2][2], minor(0, 1), minor(0, 2), minor(1, 2), whole[0] + whole[1] + whole[2]];
    $("body").textContent = minors.every((x) => x >= -1e-9)
      ? ""
      : "No rigid body has this inertia: of its principal moments, two together are less than the third.";
  }

  function moved() {
    judgeBody();
    compute();
    const keys = changed(),
      run = Number($("run").value);
    showCommand();
    const parts = keys.map((key) => [key.key, String(setting[key.key])]);
    if (run) parts.push(["run", String(run)]);
    $("link").href = `#${new URLSearchParams(parts)}`;
    history.replaceState(null, "", $("link").href);
    clearTimeout(told);
    told = window.setTimeout(tell, 900);
  }

  // Whether the configured numbers are those of eqt ----------------------------------------------

  /** Compares them, and says so. @param {Float64Array} configured */
  function check(configured) {
    const { expected, status } = stored;
    let equal = 0,
      count = 0,
      largest = 0;
    for (let row = 0; row < laws.length * data.runs; row += 1) {
      if (status[row]) continue; // of a run that failed, no number counts
      for (let j = 0; j < columns.length; j += 1) {
        const ours = configured[row * width + j],
          theirs = expected[row * columns.length + j];
        count += 1;
        if (Object.is(ours, theirs)) equal += 1;
        else if (ours !== theirs)
          largest = Math.max(largest, Math.abs(ours - theirs) / Math.max(Math.abs(theirs), 1e-300) || Infinity);
      }
    }
    checked = largest <= SAME;
    const all_ = `${count.toLocaleString("en")} configured numbers`;
    const words =
      equal === count
        ? `All ${all_} equal eqt's, to the last bit.`
        : `Of ${all_}, ${equal.toLocaleString("en")} equal eqt's to the last bit; the largest relative difference is ${largest.toPrecision(1)}.`;
    const other = data.engine ? ` The engine ${data.engine} computed the result, native computes here.` : "";
    const why = fused ? other : " This browser rounds a·b + c twice, where eqt rounds once.";
    const bad = " So this page is not the experiment, and shows no table; please report it.";
    $("check").textContent = words + why + (checked ? "" : bad);
    $("check").className = `check ${checked ? "good" : "bad"}`;
  }

  // The table ------------------------------------------------------------------------------------

  /** @param {Float64Array} numbers @param {number} law @param {number} run */
  const rowOf = (numbers, law, run) =>
    numbers.subarray((law * data.runs + run) * width, (law * data.runs + run + 1) * width);

  /** @param {Float64Array} row */
  const hasFailed = (row) => row[columns.length] || row[columns.length + 2];

  /** Returns means over the runs of a law that did not fail, and how many failed; only over those
   * that did not fail among others, too, where these are given.
   * @param {Float64Array} numbers @param {number} law @param {Float64Array} [others] */
  function means(numbers, law, others) {
    const sums = columns.map(() => 0),
      failures = new Map();
    let good = 0;
    for (let run = 0; run < data.runs; run += 1) {
      if (others && hasFailed(rowOf(others, law, run))) continue;
      const row = rowOf(numbers, law, run);
      const outcome = row[columns.length];
      if (hasFailed(row)) {
        const why = outcome ? OUTCOMES[outcome] : "turns too fast";
        failures.set(why, (failures.get(why) ?? 0) + 1);
      } else {
        good += 1;
        // A settling time is infinite where a run does not settle; a flag is 0.
        sums.forEach((_, j) => {
          sums[j] += columns[j].counts ? Number(Number.isFinite(row[j]) && row[j] !== 0) : row[j];
        });
      }
    }
    return { good, failures, values: sums.map((sum, j) => (columns[j].counts ? sum : sum / good)) };
  }

  function table() {
    if (!checked) {
      $("all").replaceChildren();
      return;
    }
    $("all").classList.remove("stale");
    const body = $("all").tBodies[0];
    body.replaceChildren(
      ...laws.map((law, k) => {
        const { good, failures, values } = means(all, k);
        // Differences are of the runs that end both as configured and now.
        const both = means(all, k, base ?? all),
          was = means(base ?? all, k, all);
        const box = html("input", { type: "checkbox" });
        box.checked = !hidden.has(k);
        box.addEventListener("change", () => {
          if (box.checked) hidden.delete(k);
          else hidden.add(k);
          draw();
        });
        const head = html("th", { scope: "row" }, html("label", {}, box, swatch(law), named(law)));
        for (const [why, count] of failures) head.append(html("span", { class: "failed" }, `${count} failed: ${why}`));
        if (both.good < Math.max(good, means(base ?? all, k).good))
          head.append(html("span", { class: "failed" }, `changes: of the ${both.good} runs that end either way`));
        const changes = both.values.map((value, j) => value - was.values[j]);
        return html("tr", {}, head, ...columns.map((column, j) => cell(column, values[j], changes[j], good)));
      }),
    );
  }

  /** @param {Column} column @param {number} value @param {number} difference @param {number} good */
  function cell(column, value, difference, good) {
    const made = html("td", {}, column.counts ? `${value}/${good}` : written(value));
    if (changed().length && Number.isFinite(difference)) {
      const rises = difference > 0,
        better = column.better && difference ? (column.better === "higher") === rises : null;
      const state = better === null ? "" : better ? " better" : " worse";
      made.append(html("span", { class: `change${state}` }, (rises ? "+" : "") + written(difference) + state));
    }
    return made;
  }

  function tell() {
    if (done < data.runs) {
      told = window.setTimeout(tell, 300);
      return;
    }
    const words = laws.map((law, k) => {
      const { good, values } = means(all, k);
      const j = columns[0].counts
        ? `${values[0]} of ${good} settled`
        : `${columns[0].name} ${written(values[0])}${inUnit(" ", columns[0].unit)}`;
      return `${law.title}: ${j}`;
    });
    $("state").textContent = words.join("; ");
  }

  // Curves of one run ----------------------------------------------------------------------------

  const WIDTH = 460,
    HEIGHT = 190,
    LEFT = 50,
    RIGHT = 10,
    TOP = 24,
    BOTTOM = 22;
  let now = 0;

  /** @param {Answer} answer */
  function show(answer) {
    if (answer.before || !changed().length) first = answer;
    else if (first?.runs[0] !== answer.runs[0]) first = null;
    if (!answer.before) shown = answer;
    draw();
  }

  /** Returns a number of a sample of the run on show.
   * @param {Answer} answer @param {number} law @param {string} name */
  function course(answer, law, name) {
    const module = data.modules.filter((each) => each.laws.includes(laws[law].label))[0];
    const [begin, shape] = module.kept[name],
      step = module.sizes.KEPT,
      size = shape.reduce((a, b) => a * b, 1);
    const kept = answer.kept[law];
    return (/** @type {number} */ sample, k = 0) => kept[sample * step + begin + Math.min(k, size - 1)];
  }

  /** @param {number} high @param {number} count */
  function ticks(high, count) {
    const power = 10 ** Math.floor(Math.log10(high / count));
    const step = ([1, 2, 2.5, 5, 10].find((k) => k * power >= (high / count) * (1 - 1e-9)) ?? 10) * power;
    return Array.from({ length: Math.floor(high / step + 1e-9) + 1 }, (_, k) => Number((k * step).toPrecision(6)));
  }

  const x = (/** @type {number} */ t) => LEFT + ((WIDTH - LEFT - RIGHT) * (t - times[0])) / (times[last] - times[0]);

  const panels = data.panels.map((head) => {
    const unit = head.unit ? ` (${head.unit})` : "";
    const svg = element("svg", {
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      role: "img",
      "aria-label": `${head.name}${unit} over time`,
    });
    const axes = svg.appendChild(element("g"));
    const frame = { x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM };
    const clip = `live-frame-${head.metric}`;
    svg.append(element("clipPath", { id: clip }, element("rect", frame)));
    const before = laws.map((law) =>
      svg.appendChild(element("path", { class: "was", stroke: law.colour, "clip-path": `url(#${clip})` })),
    );
    const curves = laws.map((law) =>
      svg.appendChild(element("path", { class: "curve", stroke: law.colour, "stroke-dasharray": dashes(law) })),
    );
    const cursor = svg.appendChild(element("line", { class: "now", y1: TOP, y2: HEIGHT - BOTTOM }));
    const below = (/** @type {string} */ index) =>
      element("tspan", { "baseline-shift": "sub", "font-size": "75%" }, index);
    svg.append(element("text", { x: LEFT, y: 14 }, ...typeset(head.name, below), unit));
    $("panels").append(html("div", { class: "panel" }, svg));
    svg.addEventListener("pointermove", (event) => {
      const box = svg.getBoundingClientRect(),
        at = ((event.clientX - box.left) / box.width) * WIDTH;
      seek(Math.round(((at - LEFT) / (WIDTH - LEFT - RIGHT)) * last));
    });
    return { head, axes, before, curves, cursor };
  });

  function draw() {
    if (!shown) return;
    const answer = shown,
      seen = laws.map((_, k) => k).filter((k) => !hidden.has(k));
    for (const panel of panels) {
      const values = laws.map((_, k) => {
        const at = course(answer, k, panel.head.metric);
        return times.map((_t, i) => at(i));
      });
      const high = 1.05 * (Math.max(...seen.flatMap((k) => values[k].filter(Number.isFinite)), 0) || 1);
      const y = (/** @type {number} */ v) => HEIGHT - BOTTOM - ((HEIGHT - TOP - BOTTOM) * Math.min(v, 9 * high)) / high;
      const path = (/** @type {number[]} */ curve) => {
        let text = "",
          pen = false;
        curve.forEach((v, i) => {
          if (Number.isFinite(v)) text += `${pen ? "L" : "M"}${x(times[i]).toFixed(1)} ${y(v).toFixed(1)}`;
          pen = Number.isFinite(v);
        });
        return text;
      };
      laws.forEach((_, k) => {
        panel.curves[k].setAttribute("d", hidden.has(k) ? "" : path(values[k]));
        const was =
          first && first !== answer && changed().length && !hidden.has(k) ? course(first, k, panel.head.metric) : null;
        panel.before[k].setAttribute("d", was ? path(times.map((_t, i) => was(i))) : "");
      });
      panel.axes.replaceChildren(
        ...ticks(high, 4).flatMap((v) => [
          element("line", { class: "gridline", x1: LEFT, x2: WIDTH - RIGHT, y1: y(v), y2: y(v) }),
          element("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, String(v)),
        ]),
        ...ticks(times[last] - times[0], 5).map((t, k, all_) =>
          element(
            "text",
            { x: x(times[0] + t), y: HEIGHT - 6, "text-anchor": k && k === all_.length - 1 ? "end" : "middle" },
            `${t}${k === all_.length - 1 ? " s" : ""}`,
          ),
        ),
      );
    }
    moment();
  }

  // The moment, and the bodies at it -------------------------------------------------------------

  /** @param {number} sample */
  function seek(sample) {
    now = Math.max(0, Math.min(last, sample));
    moment();
  }

  function moment() {
    const t = times[now];
    $("time").value = String(now);
    $("time").setAttribute("aria-valuetext", `${t.toFixed(2)} seconds`);
    $("clock").textContent = `${t.toFixed(2)} s`;
    for (const panel of panels) {
      panel.cursor.setAttribute("x1", String(x(t)));
      panel.cursor.setAttribute("x2", String(x(t)));
    }
    if (!shown) return;
    const answer = shown,
      head = panels[0].head;
    const entries = laws.flatMap((law, k) =>
      hidden.has(k)
        ? []
        : [
            html(
              "span",
              { class: "entry" },
              swatch(law),
              named(law),
              `: ${written(course(answer, k, head.metric)(now))}`,
            ),
          ],
    );
    const compared = first && first !== answer && changed().length > 0;
    $("moment").replaceChildren(
      ...typeset(head.name, (index) => html("sub", {}, index)),
      `${head.unit ? ` (${head.unit})` : ""} at ${t.toFixed(2)} s: `,
      ...entries,
      compared ? " Thin lines: as configured." : "",
    );
    bodies.forEach((svg, k) => {
      svg.parentElement?.toggleAttribute("hidden", hidden.has(k));
      if (!hidden.has(k)) body(svg, k, answer);
    });
  }

  const SIZE = 240;
  let view = scene ? [...scene.view] : [0, 0];

  const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
  const cross = (/** @type {number[]} */ a, /** @type {number[]} */ b) => [
    a[1] * b[2] - a[2] * b[1],
    a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0],
  ];

  /** The camera: rows to the right, up, and towards the eye. */
  function camera() {
    const [azimuth, elevation] = view,
      level = Math.cos(elevation);
    const towards = [level * Math.cos(azimuth), level * Math.sin(azimuth), Math.sin(elevation)];
    const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
    return [right, cross(towards, right), towards];
  }

  /** @param {Scene} seen @param {(sample: number, k: number) => number} pose @param {number} sample */
  function placed(seen, pose, sample) {
    const turned = [0, 1, 2].map((i) =>
      [0, 1, 2].map((j) => {
        const row = seen.rotation[i];
        return row && j < row.length ? pose(sample, row[j]) : Number(i === j);
      }),
    );
    const place = [0, 1, 2].map((i) => (i in seen.position ? pose(sample, seen.position[i]) : 0));
    const rotation = seen.frame.map((row) =>
      [0, 1, 2].map((j) =>
        dot(
          row,
          turned.map((each) => each[j]),
        ),
      ),
    );
    return { rotation, place: seen.frame.map((row) => dot(row, place)) };
  }

  /** @param {SVGElement} svg @param {number} law @param {Answer} answer */
  function body(svg, law, answer) {
    const seen = /** @type {Scene} */ (scene); // without one, there are no bodies
    const eye = camera(),
      scale = SIZE / 2 / seen.reach,
      parts = [],
      colour = laws[law].colour;
    const at = (/** @type {number[]} */ v) => {
      const w = v.map((value, k) => value - seen.centre[k]);
      return [SIZE / 2 + scale * dot(eye[0], w), SIZE / 2 - scale * dot(eye[1], w)];
    };
    const line = (/** @type {number[][]} */ points) =>
      points.map(([u, v], k) => `${k ? "L" : "M"}${u.toFixed(1)} ${v.toFixed(1)}`).join("");
    parts.push(element("path", { class: "ground", d: seen.ground.map((ends) => line(ends.map(at))).join("") }));
    const pose = course(answer, law, "pose"),
      desired = course(answer, law, "desired_pose");
    if (seen.position.length) {
      const every = times.map((_, i) => i).filter((i) => i % Math.ceil(last / 100) === 0);
      parts.push(
        element("path", { class: "trail target", d: line(every.map((i) => at(placed(seen, desired, i).place))) }),
      );
      const going = every.filter((i) => Number.isFinite(pose(i, seen.position[0])));
      parts.push(
        element("path", { class: "trail", stroke: colour, d: line(going.map((i) => at(placed(seen, pose, i).place))) }),
      );
    }

    /** @param {{ rotation: number[][], place: number[] }} where @param {boolean} ghost */
    function block(where, ghost) {
      const point = (/** @type {number[]} */ v) =>
        where.rotation.map((row, i) => where.place[i] + seen.length * dot(row, v));
      const paint = ghost ? "var(--soft)" : colour;
      const polygons = seen.rotors.length ? seen.rotors : seen.faces.map((face) => face.map((k) => seen.corners[k]));
      for (const polygon of polygons) {
        const outline = polygon.map(point);
        let bright = 0.25; // of a disc of a rotor, which is seen from both sides
        if (!seen.rotors.length) {
          const [a, b, , d] = outline,
            normal = cross(
              b.map((v, i) => v - a[i]),
              d.map((v, i) => v - a[i]),
            );
          const middle = outline.reduce((sum, v) => sum.map((u, i) => u + v[i] / outline.length), [0, 0, 0]);
          const out =
            dot(
              normal,
              middle.map((v, i) => v - where.place[i]),
            ) < 0
              ? -1
              : 1;
          const towards = out * dot(normal, eye[2]);
          if (towards <= 0) continue;
          bright = 0.2 + (0.45 * towards) / Math.hypot(...normal);
        }
        parts.push(
          element("path", {
            d: `${line(outline.map(at))}Z`,
            fill: ghost ? "none" : paint,
            "fill-opacity": bright.toFixed(2),
            stroke: paint,
          }),
        );
      }
      ["x", "y", "z"].forEach((name, k) => {
        const tip = point([0, 1, 2].map((i) => Number(i === k))),
          beyond = point([0, 1, 2].map((i) => 1.18 * Number(i === k)));
        parts.push(
          element("path", { class: ghost ? "reference" : "axis-of-body", d: line([at(where.place), at(tip)]) }),
        );
        const [u, v] = at(beyond);
        if (!ghost) parts.push(element("text", { x: u.toFixed(1), y: v.toFixed(1), fill: "currentColor" }, name));
      });
    }
    block(placed(seen, desired, now), true);
    const where = placed(seen, pose, now);
    if (where.rotation.flat().every(Number.isFinite)) block(where, false);
    else parts.push(element("text", { x: SIZE / 2, y: SIZE - 8, fill: colour }, "run failed"));
    seen.inertial.forEach(([name, axis]) => {
      const [u, v] = [dot(eye[0], axis), -dot(eye[1], axis)],
        corner = [30, SIZE - 28];
      parts.push(element("path", { class: "inertial", d: line([corner, [corner[0] + 20 * u, corner[1] + 20 * v]]) }));
      parts.push(element("text", { class: "inertial-name", x: corner[0] + 29 * u, y: corner[1] + 29 * v }, name));
    });
    svg.replaceChildren(...parts);
  }

  /** @param {number} azimuth @param {number} elevation */
  function turn(azimuth, elevation) {
    view = [view[0] + azimuth, Math.min(Math.max(view[1] + elevation, -1.55), 1.55)];
    moment();
  }

  /** @type {SVGElement[]} */
  const bodies = scene
    ? laws.map((law) => {
        const svg = /** @type {any} */ (
          element("svg", {
            viewBox: `0 0 ${SIZE} ${SIZE}`,
            role: "img",
            tabindex: 0,
            "aria-label": `Body under ${law.title} and the desired one; arrow keys turn the view`,
          })
        );
        $("bodies").append(html("figure", {}, svg, html("figcaption", {}, named(law))));
        /** @type {number[] | null} */
        let held = null;
        svg.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
          held = [event.clientX, event.clientY];
          svg.setPointerCapture(event.pointerId);
        });
        svg.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
          if (!held) return;
          turn((held[0] - event.clientX) / 90, (event.clientY - held[1]) / 90);
          held = [event.clientX, event.clientY];
        });
        svg.addEventListener("pointerup", () => {
          held = null;
        });
        svg.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
          const step = /** @type {Record<string, number[]>} */ ({
            ArrowLeft: [0.1, 0],
            ArrowRight: [-0.1, 0],
            ArrowUp: [0, 0.1],
            ArrowDown: [0, -0.1],
          })[event.key];
          if (!step) return;
          event.preventDefault();
          turn(step[0], step[1]);
        });
        return svg;
      })
    : [];

  // Nothing moves by itself: a run is played where somebody asks for it.
  let playing = false,
    before = 0,
    position = 0;
  function play(/** @type {boolean} */ on) {
    playing = on;
    $("play").textContent = on ? "❚❚ Pause" : "▶ Play";
    $("play").setAttribute("aria-pressed", String(on));
    if (!on) return;
    position = now >= last ? 0 : now;
    before = performance.now();
    requestAnimationFrame(step);
  }
  function step(/** @type {number} */ instant) {
    if (!playing) return;
    position += (((instant - before) / 1000) * last) / (times[last] - times[0]);
    before = instant;
    seek(Math.floor(position));
    if (position >= last) play(false);
    else requestAnimationFrame(step);
  }
  $("play").addEventListener("click", () => play(!playing));
  $("time").addEventListener("input", () => seek(Number($("time").value)));
  $("run").addEventListener("change", () => {
    const run = Math.round(Number($("run").value));
    $("run").value = String(Number.isFinite(run) ? Math.max(0, Math.min(data.runs - 1, run)) : 0);
    moved();
  });
  window.addEventListener("beforeprint", () => {
    for (const folded of document.querySelectorAll("details")) folded.open = true;
  });
  const theme = /** @type {HTMLSelectElement} */ (document.getElementById("theme"));
  theme.addEventListener("change", () => {
    if (theme.value) document.documentElement.dataset.theme = theme.value;
    else delete document.documentElement.dataset.theme;
  });
  $("copy").addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText($("command").textContent);
      $("copy").textContent = "Copied";
    } catch {
      getSelection()?.selectAllChildren($("command"));
      $("copy").textContent = "Selected: copy it by the keyboard";
    }
    window.setTimeout(() => ($("copy").textContent = "Copy"), 2000);
  });
  // A report has fragments of other parts, too, as #figures.
  const isSetting = () => location.hash.includes("=");
  window.addEventListener("hashchange", () => {
    if (location.hash.length > 1 && !isSetting()) return;
    fromFragment();
    moved();
  });

  $("check").textContent = "Computing the configured runs …";
  if (isSetting()) fromFragment();
  start(new URLSearchParams(location.search).get("fused") !== "no");
  if (changed().length) showCommand();
  judgeBody();
  // For tests and for the curious.
  Object.assign(window, {
    eqtLive: {
      data,
      setting,
      fields,
      moved,
      get shown() {
        return shown;
      },
      get all() {
        return all;
      },
      get done() {
        return done >= data.runs && base !== null;
      },
      get ms() {
        return spent;
      },
      get fused() {
        return fused;
      },
    },
  });
})();
