"""A function of numbers as a straight-line program; it knows no group, no law and no engine."""

from eqt_cli.program.program import COMPARISONS, Constant, Input, Operation, Output, Program
from eqt_cli.program.symbols import Symbol, traced

__all__ = ["COMPARISONS", "Constant", "Input", "Operation", "Output", "Program", "Symbol", "traced"]
