"use strict";
// The computation of a live page, in a worker: numbers of a setting in, numbers of runs out.

/**
 * @typedef {{ array: string, at: number[], by: number[] | null, table: number[][] | null }} Effect
 * @typedef {{ key: string, unit: string, shown: string, values: number[], base: number, effects: Effect[] }} Key
 * @typedef {{ wasm: { fused: string, plain: string }, sizes: Record<string, number>, laws: string[],
 *   metrics: string[], kept: Record<string, [number, number[]]> }} Module
 * @typedef {{ array: string, matrix: number, inverse: number, size: number, row: number }} Inverse
 * @typedef {{ modules: Module[], keys: Key[], inverses: Inverse[], laws: { label: string }[],
 *   columns: { metric: string }[], numbers: string, runs: number,
 *   index: Record<string, [number, number, number]>,
 *   solver: { rtol: number, atol: number, most_steps: number } }} Live
 * @typedef {{ data: Float64Array, rows: number, width: number }} Table
 */

const ARRAYS = [
  "parameters",
  "starts",
  "held",
  "held_at_samples",
  "held_at_start",
  "times",
  "columns",
  "memory_before",
  "errors",
  "spans",
  "kept",
  "numbers",
  "ended",
];
const END = 3; // numbers of a run behind those of the columns: outcome, steps, whether it diverged

/** @param {string} text @returns {Promise<ArrayBuffer>} */
function unpacked(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

/** A double as an integer times a power of two. @param {number} x @returns {[bigint, number]} */
function parts(x) {
  const bits = new DataView(new ArrayBuffer(8));
  bits.setFloat64(0, x);
  const word = bits.getBigUint64(0),
    exponent = Number((word >> 52n) & 2047n),
    low = word & 0xfffffffffffffn;
  const size = exponent ? low | 0x10000000000000n : low;
  return [word >> 63n ? -size : size, (exponent || 1) - 1075];
}

/** The double nearest to p / q 2^e; a quotient with 64 bits or more and a sticky one rounds once.
 * @param {bigint} p @param {bigint} q @param {number} e */
function nearest(p, q, e) {
  const negative = p < 0n !== q < 0n,
    [a, b] = [p < 0n ? -p : p, q < 0n ? -q : q];
  if (!a) return 0;
  const shift = Math.max(0, b.toString(2).length - a.toString(2).length + 66);
  const scaled = a << BigInt(shift),
    quotient = scaled / b;
  const number = Number((quotient << 1n) | (quotient * b === scaled ? 0n : 1n)) * 2 ** (e - shift - 1);
  return negative ? -number : number;
}

/** The inverse of a symmetric positive definite matrix, in exact fractions, rounded once, as in
 * numbers/rounded.py. @param {Float64Array} matrix @param {number} n */
function inverted(matrix, n) {
  const split = Array.from(matrix, parts),
    least = Math.min(...split.map(([size, e]) => (size ? e : 2000)));
  const entry = (/** @type {number} */ k) => (split[k][0] ? split[k][0] << BigInt(split[k][1] - least) : 0n);
  const work = Array.from({ length: n }, (_, i) =>
    Array.from({ length: 2 * n }, (_, j) => (j < n ? entry(i * n + j) : BigInt(j - n === i))),
  );
  let before = 1n; // elimination without fractions, after Bareiss
  for (let k = 0; k < n; k += 1) {
    const row = work[k],
      pivot = row[k];
    for (let other = 0; other < n; other += 1) {
      const factor = work[other][k];
      if (other !== k) work[other] = work[other].map((x, j) => (x * pivot - factor * row[j]) / before);
    }
    before = pivot;
  }
  return work.flatMap((row, i) => row.slice(n).map((x) => nearest(x, row[i], -least)));
}

/** The laws that share a program, and its memory. */
class Loop {
  /** @param {WebAssembly.Exports} exports @param {Module} meta */
  constructor(exports, meta) {
    this.meta = meta;
    this.exports = /** @type {any} */ (exports);
    const sizes = (this.sizes = meta.sizes);
    this.strides = {
      parameters: sizes.PARAMETERS,
      starts: sizes.START,
      errors: (sizes.TICKS + 1) * (sizes.ERRORS + 1),
    };
    /** @type {Record<string, Float64Array>} */
    this.memory = {};
    ARRAYS.forEach((name, k) => {
      this.memory[name] = new Float64Array(this.exports.memory.buffer, this.exports.place(k));
    });
  }

  get fuses() {
    const e = 2 ** -30;
    return this.exports.fused(1 + e, 1 + e, -(1 + 2 * e)) === e * e;
  }

  /** Copies rows into memory, one after the other at a distance.
   * @param {string} name @param {Table} table @param {number} stride */
  fill(name, table, stride) {
    for (let row = 0; row < table.rows; row += 1) {
      this.memory[name].set(table.data.subarray(row * table.width, (row + 1) * table.width), row * stride);
    }
  }
}

/** All programs of a page with their numbers. */
class Experiment {
  /** @param {Live} data @param {boolean} mayFuse @returns {Promise<Experiment>} */
  static async of(data, mayFuse = true) {
    const numbers = new Float64Array(await unpacked(data.numbers));
    /** @param {"fused" | "plain"} kind */
    const loops = (kind) =>
      Promise.all(
        data.modules.map(
          async (meta) =>
            new Loop((await WebAssembly.instantiate(await unpacked(meta.wasm[kind]), {})).instance.exports, meta),
        ),
      );
    let made = null;
    try {
      if (mayFuse) made = await loops("fused");
    } catch {
      /* a browser without these instructions */
    }
    const fused = made !== null && made.every((loop) => loop.fuses);
    return new Experiment(data, numbers, fused && made ? made : await loops("plain"), fused);
  }

  /** @param {Live} data @param {Float64Array} numbers @param {Loop[]} loops @param {boolean} fused */
  constructor(data, numbers, loops, fused) {
    Object.assign(this, { data, loops, fused });
    this.data = data;
    this.loops = loops;
    this.fused = fused;
    /** @type {Record<string, Table>} */
    this.tables = {};
    for (const [name, [begin, rows, width]] of Object.entries(data.index)) {
      this.tables[name] = { data: numbers.subarray(begin, begin + rows * width), rows, width };
    }
    loops.forEach((loop, k) => {
      const sizes = loop.sizes;
      for (const [name, width] of [
        ["times", 1],
        ["columns", sizes.COLUMNS + 1],
        ["memory_before", 1],
        ["spans", 9],
      ]) {
        loop.fill(String(name), this.tables[`module ${k}/${name}`], Number(width));
      }
    });
  }

  /** The numbers of a setting: positions of the sliders, or other values of those without a table.
   * @param {Record<string, number>} setting @returns {Record<string, Table>} */
  inputs(setting) {
    const tables = { ...this.tables };
    /** @type {Set<string>} */
    const changed = new Set();
    for (const key of this.data.keys) {
      const value = setting[key.key] ?? key.values[key.base];
      if (value === key.values[key.base]) continue;
      const position = key.values.indexOf(value);
      for (const effect of key.effects) {
        if (!changed.has(effect.array)) {
          tables[effect.array] = { ...tables[effect.array], data: tables[effect.array].data.slice() };
          changed.add(effect.array);
        }
        const { data } = tables[effect.array];
        effect.at.forEach((place, k) => {
          data[place] = effect.by ? effect.by[k] * value : (effect.table ?? [])[position][k];
        });
      }
    }
    for (const { array, matrix, inverse, size, row } of this.data.inverses) {
      if (!changed.has(array)) continue;
      const { data, width } = tables[array],
        begin = row * width + matrix;
      data.set(inverted(data.subarray(begin, begin + size * size), size), row * width + inverse);
    }
    return tables;
  }

  /** Computes runs of all laws: for each law and run the columns, outcome, steps, divergence.
   * @param {Record<string, number>} setting @param {number[]} runs @param {boolean} whole
   * @returns {{ numbers: Float64Array, kept: Float64Array[], ms: number }} */
  compute(setting, runs, whole) {
    const tables = this.inputs(setting),
      { columns, laws, solver } = this.data;
    const width = columns.length + END,
      numbers = new Float64Array(laws.length * runs.length * width);
    /** @type {Float64Array[]} */
    const kept = laws.map(() => new Float64Array(0));
    const begun = performance.now();
    for (const loop of this.loops) {
      const { sizes, meta, memory } = loop,
        first = meta.laws[0];
      loop.fill("held", tables[`${first}/held`], sizes.HELD + 1);
      loop.fill("held_at_samples", tables[`${first}/held_at_samples`], sizes.HELD_AT_SAMPLES + 1);
      loop.fill("held_at_start", tables[`${first}/held_at_start`], sizes.HELD_AT_START + 1);
      const rows = meta.laws.flatMap((label) => runs.map((run, k) => ({ label, run, k })));
      const places = columns.map(({ metric }) => meta.metrics.indexOf(metric));
      const diverged = meta.metrics.indexOf("turns too fast");
      for (let begin = 0; begin < rows.length; begin += sizes.RUNS) {
        const some = rows.slice(begin, begin + sizes.RUNS);
        some.forEach(({ label, run }, lane) => this.place(loop, tables, label, run, lane));
        loop.exports.live(some.length, solver.rtol, solver.atol, solver.most_steps);
        some.forEach(({ label, k }, lane) => {
          const law = laws.findIndex((each) => each.label === label);
          // The C writes the numbers of all runs of a call one after the other, for each metric.
          const number = (/** @type {number} */ place) => memory.numbers[place * sizes.RUNS + lane];
          const out = (law * runs.length + k) * width;
          places.forEach((place, j) => {
            numbers[out + j] = place < 0 ? NaN : number(place);
          });
          numbers.set(memory.ended.subarray(3 * lane, 3 * lane + 2), out + columns.length);
          numbers[out + columns.length + 2] = diverged < 0 ? 0 : number(diverged);
          const length = sizes.SAMPLES * sizes.KEPT;
          if (whole && k === 0) kept[law] = memory.kept.slice(lane * length, (lane + 1) * length);
        });
      }
    }
    return { numbers, kept, ms: performance.now() - begun };
  }

  /** Puts the numbers of one run into a lane.
   * @param {Loop} loop @param {Record<string, Table>} tables @param {string} label
   * @param {number} run @param {number} lane */
  place(loop, tables, label, run, lane) {
    const { memory, sizes, strides } = loop,
      parameters = tables[`${label}/parameters`];
    const row = (/** @type {Table} */ { data, rows, width }, k = rows === 1 ? 0 : run) =>
      data.subarray(k * width, (k + 1) * width);
    memory.parameters.set(row(parameters), lane * strides.parameters);
    memory.starts.set(row(tables.starts, run), lane * strides.starts);
    const errors = tables[`${label}/errors`];
    if (!errors) return;
    const drawn = row(errors, run);
    for (let tick = 0; tick < sizes.TICKS; tick += 1) {
      const of = drawn.subarray(tick * sizes.ERRORS, (tick + 1) * sizes.ERRORS);
      memory.errors.set(of, lane * strides.errors + tick * (sizes.ERRORS + 1));
    }
  }
}

/** @type {Experiment | null} */
let experiment = null;
self.onmessage = async ({ data: message }) => {
  try {
    if (message.load) {
      experiment = await Experiment.of(message.load, message.mayFuse);
      const { expected, status } = experiment.tables;
      self.postMessage({
        ready: true,
        fused: experiment.fused,
        expected: expected.data.slice(),
        status: status.data.slice(),
      });
    } else if (experiment) {
      const { id, setting, runs, whole, before } = message;
      self.postMessage({ id, runs, whole, before, ...experiment.compute(setting, runs, whole) });
    }
  } catch (error) {
    self.postMessage({ failed: String(error) });
  }
};
