"""The whitelisted grammar of reference torques and constants; it knows no config and no engine.

An expression is made of numbers, ``pi``, the variables that the caller allows (``t`` by default),
``+ - * / **``, parentheses, the one-argument functions of `eqt_cli.core.arrays.FUNCTIONS`, and
those of `PIECEWISE`; a comparison stands in ``where(t < 1, a, b)`` and nowhere else.
Precedence is Python's: ``-2**2`` is −4, ``2**3**2`` is 512. There is no ``e``, since it is as often
the start of an exponent; write ``exp(1)``. Text is parsed by hand and never handed to Python.
"""

from eqt_cli.core.expressions.expression import Expression, constant, formula, parse

__all__ = ["Expression", "constant", "formula", "parse"]
