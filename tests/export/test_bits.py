"""What the engine native evaluates at a control instant is the exported function, bit for bit."""

import ctypes

import numpy as np
import pytest
from exported_laws import ALL, compilers, law_of, written
from exported_laws import library as compiled

from eqt_cli.engines.native import compiler, library
from eqt_cli.engines.native.library import Rows
from eqt_cli.engines.traced_loop import at_instants, held_rows, parameter_rows, trace
from eqt_cli.execution.batches import batches
from eqt_cli.experiment.study import Study


class Vehicle:
    """Calls an exported law with the structures of its header."""

    def __init__(self, law, path):
        self.law, self.library = law, ctypes.CDLL(str(path))

        def structure(entries):
            fields = [(each.name, ctypes.c_double * each.size) for each in entries]
            return type("Structure", (ctypes.Structure,), {"_fields_": fields})

        program = law.program
        self.input, self.numbers = structure(program.told), structure(program.numbers)
        self.memory = structure(program.memory)
        self.defaults = self.numbers.in_dll(self.library, f"{law.name}_defaults")

    def __call__(self, told, memory):
        given = self.input(*[tuple(np.ravel(told[each.name])) for each in self.law.program.told])
        kept = self.memory(*[tuple(memory[each.source]) for each in self.law.program.memory])
        torque = (ctypes.c_double * self.law.program.torque.size)()
        references = [ctypes.byref(each) for each in (self.defaults, kept, given)]
        getattr(self.library, f"{self.law.name}_torque")(*references, torque)
        after = [np.array(getattr(kept, each.name)) for each in self.law.program.memory]
        return np.array(torque), np.concatenate([np.empty(0), *after])


@pytest.mark.parametrize(("law", "group"), [("goodarzi2013", "SO3"), ("logarithmic", "SE2")])
def test_an_instant_of_native_has_the_bits_of_the_exported_law(tmp_path, law, group):
    compare(tmp_path, law, group)


@pytest.mark.slow("every law is compiled twice")
@pytest.mark.parametrize(("law", "group"), ALL)
def test_an_instant_of_native_has_the_bits_of_every_exported_law(tmp_path, law, group):
    compare(tmp_path, law, group)


def compare(tmp_path, law, group):
    """The torque and the memory of both, after an instant."""
    if compiler.missing():
        pytest.skip("no C compiler")
    found = law_of(group, law)
    loop = found.loop
    vehicle = Vehicle(found, compiled(found, written(found, tmp_path), compilers()[0]))
    [batch] = batches(Study(None, found.experiment), law, np.arange(2))
    problem, parts = batch.problem, at_instants(batch.problem.loop)
    G, states = loop.group, problem.states.copy()
    if "desired_pose" in loop.layout.slices:  # a pose in which no entry is 0 or 1
        turned = G.exp(0.3 * np.arange(1, 1 + G.dimension))
        states[:, loop.layout.slices["desired_pose"]] = G.pack(turned)
    if found.program.memory:  # as if it had flown
        where = loop.layout.slices["controller.integral"]
        states[:, where] = 0.1 * np.arange(1, 1 + where.stop - where.start)
    rows = [
        Rows(states, by_run=True),
        Rows(np.array([0.0])),
        Rows(parameter_rows(problem), by_run=True),
        Rows(held_rows(loop, np.array([0.0]))[0]),
    ]
    lengths = tuple(each.length for each in rows)
    told = library.evaluation(parts.told, lengths)(problem.runs, 1, rows)
    instant = library.evaluation(trace(loop).after_instant, lengths)
    after = instant(problem.runs, 1, rows)["state"][:, 0]
    memory, later = loop.memory(states), loop.memory(after)
    for run in range(problem.runs):
        one = {name: values[run, 0] for name, values in told.items()}
        torque, kept = vehicle(one, {name: z[run] for name, z in memory.items()})
        asked = loop.vehicle.last_command(loop.group, loop.tracking(0.0, after[run]).vehicle)
        assert torque.tobytes() == asked.tobytes()
        assert np.abs(torque).max() > 1e-3
        for z in later.values():
            assert kept.tobytes() == z[run].tobytes()
