"""A loop in C++: Boost's odeint, run by run, on the literal equations, in one thread."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from benchmarks.contenders.plain_loop import body, literal, starts
from eqt_cli.base.arrays import Array

SOURCE = Path(__file__).parents[1] / "literal" / "so3.cpp"

LAWS = ("eqt", "gt", "nog", "asym")
"""As they are numbered there."""


@dataclass(frozen=True)
class CppLoop(Contender):
    """Dormand and Prince's method of order 5 with dense output, in steps of a tolerance."""

    def missing(self) -> str | None:
        """A compiler and Boost."""
        if not (compiler := shutil.which("g++")):
            return "needs g++"
        includes = [compiler, "-E", "-x", "c++", "-o", "/dev/null", "-"]
        header = b"#include <boost/numeric/odeint.hpp>"
        found = subprocess.run(includes, input=header, capture_output=True, check=False)
        return "needs the headers of Boost" if found.returncode else None

    def plays(self, case: Case) -> bool:
        """Attitude only."""
        return case.experiment.group.name == "SO3"

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Compile."""
        with TemporaryDirectory() as folder:
            built = Path(folder, "so3.so")
            options = ["-std=c++17", "-O3", "-march=native", "-shared", "-fPIC"]
            subprocess.run(["g++", *options, str(SOURCE), "-o", str(built)], check=True)
            integrate = ctypes.CDLL(str(built)).integrate
        every, times = np.arange(len(case.Q)), case.times  # a new array at every call
        began, numbers = starts(case, every), np.concatenate([x.ravel() for x in body(case)])

        def solve() -> Array:
            found = np.empty((len(case.problems), len(began), len(times), 24))
            for own, law in zip(found, case.experiment.loops, strict=True):
                integrate(
                    LAWS.index(law),
                    _of(numbers),
                    len(began),
                    _of(began),
                    len(times),
                    _of(times),
                    ctypes.c_double(tolerance),
                    _of(own),
                )
            return found

        return solve

    def motion(self, case: Case, solution: Any) -> Motion:
        """That of all runs."""
        Q, V = literal(case).motion(solution)
        return Motion(Q, V, np.arange(len(case.Q)))


def _of(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


CONTENDERS = [CppLoop("C++ loop, odeint", (1e-5, 1e-7, 1e-9, 1e-11), 1e-9)]
