"""Diffrax: the literal equations in JAX, all runs of a controller in one vmap, in doubles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from benchmarks.cases import Case, Motion
from benchmarks.contenders.base import Contender, Solve
from benchmarks.contenders.plain_loop import body, literal, starts


@dataclass(frozen=True)
class Diffrax(Contender):
    """Dopri8 with adaptive steps for each run, compiled by XLA."""

    def missing(self) -> str | None:
        """jax or diffrax."""
        if find_spec("jax") and find_spec("diffrax"):
            return None
        return "diffrax is not installed (pip install --group bench)"

    def prepare(self, case: Case, tolerance: float) -> Solve:
        """Compile each law for all runs at once."""
        import diffrax
        import jax

        jax.config.update("jax_enable_x64", True)
        field, times = literal(case).field, jax.numpy.asarray(case.times)
        numbers = tuple(map(jax.numpy.asarray, body(case)))

        def one(law: str, y: Any) -> Any:
            term = diffrax.ODETerm(lambda t, y, args: field(jax.numpy, t, y, law, numbers))
            return diffrax.diffeqsolve(
                term,
                diffrax.Dopri8(),
                t0=times[0],
                t1=times[-1],
                dt0=None,
                y0=y,
                saveat=diffrax.SaveAt(ts=times),
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance * 1e-3),
                max_steps=100_000,
            ).ys

        y = jax.numpy.asarray(starts(case, np.arange(len(case.Q))))
        compiled = [
            jax.jit(jax.vmap(partial(one, law))).lower(y).compile() for law in case.experiment.loops
        ]

        def solve() -> list[Any]:
            return [jax.block_until_ready(each(y)) for each in compiled]

        return solve

    def motion(self, case: Case, solution: list[Any]) -> Motion:
        """That of all runs."""
        Q, V = literal(case).motion(np.array(solution))
        return Motion(Q, V, np.arange(len(case.Q)))


TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11, 1e-12)
CONTENDERS = [Diffrax("diffrax vmap (Dopri8)", TOLERANCES, 1e-9)]
