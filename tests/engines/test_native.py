"""The same bits: by any number of lanes, compiler, processor, thread and group of runs."""

import dataclasses
import hashlib
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from case_tables import in_ci
from emulated_arm import emulated_arm

import eqt_cli
from eqt_cli.engines import compiler, library, native
from eqt_cli.engines.library import evaluation_source, integration_source
from eqt_cli.extend import SolveIvp, TaskContext
from eqt_cli.results.result import open_result
from eqt_cli.runs.batches import batches
from eqt_cli.runs.compute_part import compute_part, shared_reference

pytestmark = pytest.mark.skipif(
    native.Native.unavailable() is not None, reason="needs a C compiler"
)

RUNS = 5
"""No multiple of the lanes."""

FLIES = yaml.safe_load("""
plant:
  inertia: {relative: {uniform: [-0.1, 0.1]}}
  forces: [{kind: gust, std: 0.1, time_constant: 1}]
actuators: [{kind: limit, limit: 0.9}, {kind: lag, time_constant: 0.1}]
control: {period: 0.1, delay: 1}
sensors:
  pose: [{kind: noise, std: 0.01}]
  velocity: [{kind: bias, value: {normal: [0, 0.1]}, walk: 0.01}]
""")
"""A sampled, noisy loop, with limits that are reached."""

LOOPS = {"SE3": ("se3", {}), "flies": ("paper", FLIES)}


@pytest.fixture(scope="module", params=["flies", in_ci("compiles a larger group, too", "SE3")])
def loop(request):
    """The study of a few short runs, by the name of the loop."""
    name, changes = LOOPS[request.param]
    few = {"ensemble.runs": RUNS, "time.duration": 1.5, "time.samples": 16, "controllers": ["eqt"]}
    return study_of(name, {"solver": {"engine": "native", "cross_check": 0}, **few, **changes})


def study_of(name, changes):
    path = Path(__file__).parents[2] / "configs" / f"{name}.yaml"
    return eqt_cli.load_experiment(path, changes)


@pytest.fixture(scope="module")
def batch(loop):
    (found,) = batches(loop, "eqt", np.arange(RUNS))
    return found


@pytest.fixture(scope="module")
def expected(batch):
    return solved(batch)


def solved(batch, workers=1):
    """The digest of a whole solution."""
    found = batch.engine.solve(batch.problem, workers)
    assert not found.status.any()
    return digest(found.states, found.steps)


def digest(*arrays):
    """The SHA-256 of the bits of some arrays."""
    return hashlib.sha256(b"".join(each.tobytes() for each in arrays)).hexdigest()


@pytest.fixture
def built(monkeypatch):
    """Lets all laws be compiled anew, in another way."""

    def by(lanes=4, **compiled_by):
        chosen = dataclasses.replace(compiler.compiler(), **compiled_by)
        monkeypatch.setattr(compiler, "compiler", lambda: chosen)
        monkeypatch.setattr(compiler.Compiler, "lanes", lanes)
        for name in ("_integrator", "_evaluate"):
            monkeypatch.setattr(library, name, getattr(library, name).__wrapped__)

    return by


@pytest.mark.parametrize("called", ["clang", in_ci("cc is gcc on most machines", "gcc")])
def test_compilers_change_no_bit(batch, expected, built, called):
    if not (found := shutil.which(called)):
        pytest.skip(f"needs {called}")
    built(command=(found,))
    assert solved(batch) == expected


@pytest.mark.ci("ziglang first compiles a part of itself")
def test_the_compiler_in_a_wheel_changes_no_bit(batch, expected, built):
    if not find_spec("ziglang"):
        pytest.skip("needs ziglang")
    built(command=(sys.executable, "-m", "ziglang", "cc"))
    assert solved(batch) == expected


def test_threads_and_groups_change_no_bit(batch, expected, monkeypatch):
    for size in (1, 2, 3):
        monkeypatch.setattr(native, "GROUP_RUNS", size)
        assert solved(batch, workers=1 + size % 2) == expected


@pytest.mark.parametrize(
    ("runs", "spans", "threads", "sizes"),
    [
        *((600, 1, 1, [200, 200, 200]), (600, 1, 2, [150, 150, 150, 150])),
        *((600, 2, 2, [300, 300]), (5, 1, 2, [3, 2]), (5, 3, 1, [5]), (1, 1, 4, [1])),
        (256, 1, 1, [256]),
    ],
)
def test_groups_are_of_256_runs_at_most_and_as_many_for_each_thread(runs, spans, threads, sizes):
    problem = SimpleNamespace(runs=runs, spans=[None] * spans)
    groups = native.Native().groups(problem, threads)
    assert [len(group) for group in groups] == sizes
    np.testing.assert_array_equal(np.concatenate(groups), np.arange(runs))


@pytest.mark.parametrize(
    ("samples", "spans", "threads", "sampled", "sizes"),
    [
        (2000, 1, 1, False, [34, 33, 33]),
        (2000, 1, 2, False, [50, 50]),
        (2000, 2, 1, False, [100]),
        (200_000, 1, 30, False, [25, 25, 25, 25]),
        (2000, 50, 1, True, [25, 25, 25, 25]),
    ],
)
def test_a_block_fills_16_mebibytes_for_each_thread(samples, spans, threads, sampled, sizes):
    """At most 41 runs of 2,000 samples of 25 numbers; with errors at 5,000 ticks, twice 15."""
    problem = SimpleNamespace(
        runs=100,
        spans=[None] * spans,
        times=np.zeros(samples),
        control_instants=5000 if sampled else 0,
        loop=SimpleNamespace(
            state_length=25,
            group=SimpleNamespace(dimension=9),
            vehicle=SimpleNamespace(control="sampled" if sampled else None, solves=0),
        ),
    )
    blocks = native.Native().blocks(problem, threads)
    assert [len(block) for block in blocks] == sizes
    np.testing.assert_array_equal(np.concatenate(blocks), np.arange(100))


@pytest.mark.parametrize(("rtol", "got"), [(1e-13, "1e-13"), (1.0, "1")])
def test_message_of_a_tolerance_that_doubles_cannot_meet(rtol, got, noted):
    message = f"expected a number from 2.22e-13 to 1, got {got}"
    assert noted(native.Native(rtol=rtol)) == [("rtol", message)]
    assert noted(native.Native(rtol=native.SMALLEST_RTOL)) == []


def test_long_runs_of_an_explicit_method_are_compiled():
    [batch] = batches(study_of("paper", {"ensemble.runs": 2}), "eqt", np.arange(2))
    short = dataclasses.replace(batch.problem, times=batch.problem.times[:10])
    given = SolveIvp(rtol=1e-7, atol=1e-10), SolveIvp(method="Radau"), native.Native(rtol=1e-5)
    assert native.compiled_if_faster(given[0], batch.problem) == native.Native(1e-7, 1e-10)
    kept = [native.compiled_if_faster(engine, batch.problem) for engine in given[1:]]
    assert kept == [*given[1:]]
    assert native.compiled_if_faster(given[0], short) is given[0]


def test_work_for_stability_is_that_of_dop853():
    rates = np.array([[-50.0, -1.0], [-70.0, -2.0]])
    expected = SolveIvp().work_for_stability(rates, 3.0).amount / 12  # its stages
    assert native.Native().work_for_stability(rates, 3.0).amount == pytest.approx(expected)


def test_groups_need_not_be_neighbours(batch, expected, monkeypatch):
    every_other = [np.arange(start, RUNS, 2) for start in (0, 1)]
    monkeypatch.setattr(native.Native, "groups", lambda *_: every_other)
    assert solved(batch) == expected


def test_other_runs_change_no_bit(batch):
    together = batch.engine.solve(batch.problem)
    for run in range(RUNS):
        alone = batch.engine.solve(batch.problem.select(np.array([run])))
        assert alone.states.tobytes() == together.states[[run]].tobytes()
        assert alone.steps == together.steps[run]
    backwards = batch.engine.solve(batch.problem.select(np.arange(RUNS)[::-1]))
    assert backwards.states[::-1].tobytes() == together.states.tobytes()


# The tests compile without optimisation, users as the first of these. On x86-64, `-O3` alone has
# vectors of two numbers, and fused products in a function of libm only.
@pytest.mark.parametrize(
    ("lanes", "flags"),
    [
        (2, ("-O2", "-march=native")),
        in_ci("for no processor of today", 1, ("-O3",)),
        in_ci("compiles it again", 8, ("-O0",)),
        in_ci("compiles it again", 4, ("-O2", "-march=native", "-Og")),
    ],
)
def test_lanes_processors_and_optimisation_change_no_bit(loop, built, lanes, flags):
    """Of states, signals and metrics."""
    expected = stored(loop)
    assert {"pose", "velocity"} < set(expected)
    built(lanes, flags=flags)
    assert stored(loop) == expected


def stored(study):
    """The digest of every variable of a part."""
    part = compute_part(study, study.plan.part(0), shared_reference(study), TaskContext())
    numbers = {name: values for name, values in part.data.items() if name != "message"}
    return {name: digest(values) for name, values in numbers.items()}


def forget():
    """Let all laws be compiled, or loaded, as in another process."""
    library._integrator.cache_clear()
    library._evaluate.cache_clear()


def test_results_say_how_they_were_compiled_and_depend_on_it_in_no_number(run, invoke, monkeypatch):
    if not (other := shutil.which("clang") or shutil.which("gcc")):
        pytest.skip("needs clang or gcc beside cc")
    run("solver.engine=native", out="one", controllers="[eqt]")
    forget()
    monkeypatch.setenv("CC", other)
    words = ("--executor", "threads", "--workers", 2)
    invoke("run", "c.yaml", "--set=solver.engine=native", "--out", "other", *words)
    with open_result("one") as a, open_result("other") as b:
        assert b.provenance["compiler"] == compiler.compiler().described
        assert (a.provenance["lanes"], b.provenance["lanes"]) == (
            str(compiler.compiler().lanes),
        ) * 2
        assert a.provenance["compiler"] != b.provenance["compiler"]
        assert {name for name in a.names if digest(a[name]) != digest(b[name])} == set()


def test_without_a_compiler_a_result_says_nothing_of_one(monkeypatch):
    monkeypatch.setattr(compiler, "commands", list)
    assert native.Native().provenance() == {}


# Elsewhere ----------------------------------------------------------------------------------------

DRIVER = Path(__file__).with_name("native_driver.c")


@pytest.fixture(scope="module")
def alone(batch, tmp_path_factory):
    """Solves the problem by the C alone: a compiler, and what starts what it makes."""
    folder = tmp_path_factory.mktemp("alone")

    def found(command, lanes, *start):
        program = folder / "program"
        text = c_of(batch, lanes) + DRIVER.read_text(encoding="utf-8")
        flags = [*compiler.FLAGS, "-w", "-o", str(program), "-x", "c", "-", "-lm"]
        subprocess.run([*command, *flags], input=text, text=True, check=True)
        done = subprocess.run(
            [*start, str(program)], input=numbers_of(batch), capture_output=True, check=True
        )
        return done.stdout

    return found


def c_of(batch, lanes):
    """The C of a problem in one text."""
    programs = native.programs(batch.problem.loop)
    texts = [integration_source(programs.field, lanes)]
    if after := programs.after_instant:
        stretches = [length for name, length in after.inputs if name != "errors"]
        stretches += [each.shape[1] for each in errors_of(batch.problem, 0)]
        texts.append(evaluation_source(after, stretches, lanes))
    return "\n".join(texts)


def errors_of(problem, tick):
    drawn = problem.drawn() or ()
    return [each[:, tick] for each in drawn if each.size]


def numbers_of(batch):
    """The numbers of a problem as the driver reads them."""
    problem, engine = batch.problem, batch.engine
    spans, runs, field = problem.spans, problem.runs, native.programs(problem.loop).field
    lengths = [each.shape[1] for each in errors_of(problem, 0)] if problem.errors else [0, 0]
    tolerances = np.array([engine.rtol, engine.atol]) * native.STEP_SHARE
    written = [
        np.array([runs, len(spans), engine.max_steps, *lengths]),
        tolerances,
        problem.states,
        native.parameter_rows(problem),
    ]
    for span in spans:
        written += [
            np.array([span.later, span.tick is not None]),
            np.array([span.start, span.stop, *span.within]),
            span.grid[1 : 1 + span.later],
            native.held_rows(problem.loop, np.array([span.start]), field)[0],
            *(errors_of(problem, span.tick) if span.tick is not None else ()),
        ]
    return b"".join(np.ascontiguousarray(each).tobytes() for each in written)


def samples_of(batch, output):
    """The states at all samples, and the steps, of what the driver writes."""
    problem, place = batch.problem, 0
    runs, n = problem.states.shape
    found = np.empty((runs, len(problem.times), n))

    def read(samples):
        nonlocal place
        values = np.frombuffer(output, count=runs * samples * n, offset=8 * place)
        place += len(values)
        return values.reshape(runs, samples, n)

    for span in problem.spans:
        at_start = read(1)
        if span.sampled_start:
            found[:, [span.first - 1]] = at_start
        found[:, span.first : span.first + span.later] = read(span.later)
    read(1)
    return found, np.frombuffer(output, np.int64, runs, 8 * place)


@pytest.fixture(scope="module")
def here(alone):
    return alone(compiler.compiler().command, 1)


def test_the_c_alone_finds_what_the_engine_finds(batch, here):
    samples, steps = samples_of(batch, here)
    solution = batch.engine.solve(batch.problem)
    assert samples.tobytes() == solution.states.tobytes()
    assert (steps == solution.steps).all()


@pytest.mark.ci("an emulator runs the program")
@pytest.mark.parametrize("loop", ["flies"], indirect=True, scope="module")
def test_another_processor_finds_the_same_bits(alone, here):
    command, emulator = emulated_arm()
    found = alone(command, 2, emulator)
    assert hashlib.sha256(found).hexdigest() == hashlib.sha256(here).hexdigest()


def test_runs_move_from_their_own_times_as_each_alone(batch):
    """The contract of what steps runs from outside: start, stop and held numbers of each run."""
    problem, programs = batch.problem, native.programs(batch.problem.loop)
    advance = library.integration(programs.field)
    spans = [problem.spans[k % len(problem.spans)] for k in range(2, 2 + RUNS)]
    held = native.held_rows(problem.loop, np.array([x.start for x in spans]), programs.field)
    parameters, states = native.parameter_rows(problem), problem.states.copy()
    settings = {"rtol": 1e-9, "atol": 1e-12, "most_steps": 1000, "longest": np.inf}

    def moved(runs, **times):
        count, members = len(states[runs]), {"states": states[runs].copy(), "held": held[runs]}
        for name, kind in {"steps": float, "counts": int, "ends": int, "times": float}.items():
            members[name] = np.zeros(count, kind)
        members |= settings | times | {"parameters": parameters[runs], "stopped": np.zeros(1, int)}
        advance(runs=count, later=0, **members)
        return members["states"]

    periods = np.array([(x.start, x.stop, *x.within) for x in spans])
    together = moved(slice(None), periods=periods, to_next_held=held.shape[1])
    assert (together != states).any(axis=1).all()
    for run, (start, stop, first, last) in enumerate(periods.tolist()):
        ends = {"start": start, "stop": stop, "first_inside": first, "last_inside": last}
        assert (moved(slice(run, run + 1), **ends)[0] == together[run]).all()


def test_lanes_without_their_walk_end_with_a_sentence(batch):
    lanes = native.Native().integrator(batch.problem)
    lanes.runs = np.arange(RUNS)
    with pytest.raises(RuntimeError, match="`walked`"):
        lanes.begin(lanes.runs)
