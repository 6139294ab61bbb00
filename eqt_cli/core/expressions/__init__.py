"""The grammar of formulas in a configuration, such as reference torques and constants.

An expression is made of numbers, ``pi``, the variables that the caller allows (``t`` by default),
``+ - * / **``, parentheses, the one-argument functions of `eqt_cli.core.arrays.FUNCTIONS`, and
those of `PIECEWISE`. A comparison may only be the first argument of ``where(t < 1, a, b)``.
Precedence is Python's: ``-2**2`` is −4, ``2**3**2`` is 512. There is no ``e``, because it also
starts an exponent; write ``exp(1)``. The text is parsed here and never evaluated by Python.
"""

from eqt_cli.core.expressions.expression import Expression, constant, formula, parse

__all__ = ["Expression", "constant", "formula", "parse"]
