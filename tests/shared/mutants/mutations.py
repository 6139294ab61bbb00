"""Every small fault that can be planted in a source file: one changed operator, number or branch.

What is only said (docstrings, annotations, texts, errors that are raised or noted) is left alone.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

CORE = (
    "numbers",
    "components",
    "loop",
    "engines",
    "config/designs.py",
    "analysis/intervals.py",
    "analysis/compare.py",
    "analysis/comparison.py",
    "analysis/claims.py",
    "extensions/proofs/margins.py",
    "results/metrics.py",
    "results/quantity.py",
    "numbers/c_headers.py",
    "extensions/code/decisions.py",
    "extensions/code/user_code.py",
    "extensions/designed_laws",
    "extensions/logs/smoothing.py",
    "extensions/spacecraft",
    "extensions/thrusters",
    "extensions/underactuated",
)
"""What counts as the mathematical core, below `eqt_cli`; of comparisons not their words."""

READERS = ("components/pose_notation.py", "components/pose_tables.py")
"""Files in folders of the core that read text."""

_BINARY = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
_LEFT_OUT = {"transpose", "abs", "sqrt", "inverse", "copy"}
"""Functions of one argument that a fault may forget."""

_EXCHANGED = {"ad", "cross", "where"}
"""Functions whose last two arguments a fault may exchange."""


@dataclass(frozen=True)
class Mutant:
    """One fault.

    Attributes
    ----------
    path
        The source file, relative to the repository.
    function
        The outermost function or method that it lies in, as `Tracking.V_E`; the class, or nothing,
        for what is executed on import.
    change
        What stood there and what stands there now.
    line
        Where.
    count
        How many the same change in the same function come before it.
    on_import
        Whether it lies in no function.
    """

    path: str
    function: str
    change: str
    line: int
    count: int
    on_import: bool

    @property
    def key(self) -> str:
        """A name that survives edits elsewhere in the file."""
        nth = f" #{self.count + 1}" if self.count else ""
        return f"{self.path} {self.function or '-'}: {self.change}{nth}"


def source_files(root: Path, places: Iterable[str] = CORE) -> list[Path]:
    """The source files of the core, or of other places below `eqt_cli`."""
    found: list[Path] = []
    for name in places:
        place = root / "eqt_cli" / name
        found += [place] if place.suffix else sorted(place.rglob("*.py"))
    return [file for file in found if file.relative_to(root / "eqt_cli").as_posix() not in READERS]


def mutants_of(root: Path, file: Path) -> list[Mutant]:
    """All mutants of a file, in the order of its lines."""
    return [mutant for mutant, _ in _planted(root, file)]


def mutated(root: Path, mutant: Mutant) -> ast.Module:
    """The syntax tree of its file with the fault."""
    for each, tree in _planted(root, root / mutant.path):
        if each.key == mutant.key:
            return tree()
    raise LookupError(mutant.key)


def _planted(root: Path, file: Path) -> Iterator[tuple[Mutant, Callable[[], ast.Module]]]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    path, seen = file.relative_to(root).as_posix(), Counter[tuple[str, str]]()
    nodes = list(_mutable(tree, (), True))
    order = {id(node): index for index, node in enumerate(ast.walk(tree))}
    for node, names, on_import in nodes:
        for number, replacement in enumerate(_replacements(node)):
            change = f"{_written(node)} → {_written(replacement)}"
            function = ".".join(names)
            before = seen[function, change]
            seen[function, change] += 1
            mutant = Mutant(path, function, change, node.lineno, before, on_import)

            def plant(index: int = order[id(node)], number: int = number) -> ast.Module:
                again = copy.deepcopy(tree)
                target = list(ast.walk(again))[index]
                _put(again, target, list(_replacements(target))[number])
                return ast.fix_missing_locations(again)

            yield mutant, plant


def _mutable(
    node: ast.AST, names: tuple[str, ...], on_import: bool
) -> Iterator[tuple[ast.expr | ast.stmt, tuple[str, ...], bool]]:
    """The nodes that count, with the function they lie in."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or _is_said(child):
                continue
            inner, on_import_too = names, on_import
            if on_import and isinstance(child, ast.ClassDef | ast.FunctionDef):
                inner = (*names, child.name)
                on_import_too = isinstance(child, ast.ClassDef)
            if isinstance(child, ast.expr | ast.stmt):
                yield child, inner, on_import_too
            yield from _mutable(child, inner, on_import_too)


def _is_said(node: ast.AST) -> bool:
    """Texts, errors, imports, names that are exported, and what only types or programmers read."""
    if isinstance(node, ast.keyword) and node.arg in ("strict", "repr"):
        return True
    if isinstance(node, ast.BinOp) and isinstance(node.left, ast.JoinedStr):
        return True
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        called = node.value.func
        return isinstance(called, ast.Attribute) and called.attr == "add"
    if isinstance(node, ast.Assign):
        return any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def _replacements(node: ast.AST) -> Iterator[ast.expr | ast.stmt]:  # noqa: C901 a case per fault
    match node:
        case ast.BinOp(left, ast.MatMult(), right):
            if ast.dump(left) != ast.dump(right):
                yield ast.BinOp(right, ast.MatMult(), left)
        case ast.BinOp(left, operator, right) if type(operator) in _BINARY:
            if not _of_types(left):
                yield ast.BinOp(left, _BINARY[type(operator)](), right)
        case ast.AugAssign(target, operator, value) if type(operator) in _BINARY:
            yield ast.AugAssign(target, _BINARY[type(operator)](), value)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            yield operand
        case ast.Compare(left, [operator], [right]):
            for other in _COMPARED[type(operator)]:
                yield ast.Compare(left, [other()], [right])
        case ast.BoolOp(operator, values):
            other_way = ast.Or() if isinstance(operator, ast.And) else ast.And()
            yield ast.BoolOp(other_way, values)
        case ast.Constant(bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield ast.Constant(value + 1)
        case ast.If(test, body, orelse):
            yield ast.If(ast.UnaryOp(ast.Not(), test), body, orelse)
        case ast.IfExp(test, body, orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Expr(ast.Call()):
            yield ast.Pass()
        case ast.Call(function, [argument], []) if _name(function) in _LEFT_OUT:
            yield argument
        case ast.Call(function, [*first, one, other], keywords) if _name(function) in _EXCHANGED:
            yield ast.Call(function, [*first, other, one], keywords)


def _of_types(node: ast.expr) -> bool:
    """Whether `|` joins types, as in `isinstance(x, int | float)`."""
    return isinstance(node, ast.Name) and node.id[:1].isupper() and len(node.id) > 2


def _name(function: ast.expr) -> str:
    return getattr(function, "attr", getattr(function, "id", ""))


def _put(tree: ast.AST, target: ast.AST, replacement: ast.AST) -> None:
    ast.copy_location(replacement, target)
    for node in ast.walk(tree):
        for name, value in ast.iter_fields(node):
            if value is target:
                setattr(node, name, replacement)
                return
            if isinstance(value, list):
                for index, entry in enumerate(value):
                    if entry is target:
                        value[index] = replacement
                        return


def _written(node: ast.AST) -> str:
    """In short: of a branch its condition only."""
    if isinstance(node, ast.If):
        return f"if {ast.unparse(node.test)}"
    return ast.unparse(node)
