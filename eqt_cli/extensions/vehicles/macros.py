"""xacro files as URDF, without ROS and without running what they hold.

The package xacro evaluates Python in ``${…}`` and guards the names of the outermost expression
alone. Here, an expression is arithmetic, and functions of its own namespaces; what could leave
them, or need much memory, is refused before.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles import contained
from eqt_cli.extensions.vehicles.elements import MOST_BYTES, Element, content, parsed, read, shown
from eqt_cli.extensions.vehicles.request import Request

MOST_CALLS = 20_000
"""Most calls of macros, which may call each other."""

LARGEST_FACTOR = 1e30

_REFUSED = (
    *(ast.Lambda, ast.NamedExpr, ast.GeneratorExp, ast.JoinedStr, ast.Await, ast.Yield),
    *(ast.YieldFrom, ast.Starred),
)
_METHODS = {"format", "format_map", "mro"}
_TYPES = ("vars", "type", "hash", "repr", "isinstance", "issubclass", "range")
_INSIDE = ("_", "gi_", "f_", "cr_", "ag_", "tb_", "co_", "func_")


class _Guard(ast.NodeTransformer):
    """Refuses names that lead out of an expression, and guards products and powers."""

    def visit(self, node: ast.AST) -> Any:
        """Refuse other statements than arithmetic, calls and lists."""
        if isinstance(node, _REFUSED):
            raise EqtError(f"{type(node).__name__} is not read in an expression")
        name = getattr(node, "attr", None)
        if isinstance(name, str) and (name in _METHODS or name.startswith(_INSIDE)):
            raise EqtError(f"the name {name} is not read in an expression")
        return super().visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:  # its name is ast's
        """Compute products and powers of numbers alone."""
        self.generic_visit(node)
        if isinstance(node.op, ast.Mult | ast.Pow | ast.LShift):
            op = ast.Constant(type(node.op).__name__)
            guard = ast.Name("guarded", ast.Load())
            return ast.Call(guard, [op, node.left, node.right], [])
        return node


def _guarded(op: str, left: Any, right: Any) -> Any:
    """Return a product or a power of two numbers."""
    for value in (left, right):
        if not isinstance(value, int | float) or abs(value) > LARGEST_FACTOR:
            raise EqtError(f"expected numbers to multiply, got {type(value).__name__}")
    if op == "Mult":
        return left * right
    if op == "Pow" and abs(right) <= 100:
        return left**right
    raise EqtError(f"{op} is not read in an expression")


def _range(*ends: int) -> list[int]:
    """Return a list of whole numbers, up to a thousand."""
    numbers = range(*ends)
    if len(numbers) > 1000:
        raise EqtError("range: expected at most 1000 numbers")
    return list(numbers)


def read_xacro(request: Request) -> Element:
    """Return the URDF that xacro makes of a file; places name the link, since lines are lost.

    Raises
    ------
    EqtError
        Without the package xacro, and with what it says of the file.
    """
    if find_spec("xacro") is None:
        raise EqtError(
            f"{request.path}: macros of xacro need the package xacro; run pip install "
            "'.[xacro]' in the checkout of eqt"
        )
    path, where = request.path.resolve(), shown(request.path)
    read(path)  # refuses document types, depth and size
    text = contained.answer("xacro", request)
    root = parsed(text.encode(), path, lambda _: where)
    for child in root.children:
        of = child if child.attributes.get("name") else next(child.all("plugin"), child)
        label = of.attributes.get("name") or child.attributes.get("reference", "")
        for element in child.walk():
            element.place = f"{where}: {of.tag} {label}"
    return root


def expanded(xacro: Any, request: Request) -> str:
    """Return the text of URDF that xacro makes of a file, in this process.

    Raises
    ------
    EqtError
        With what xacro says of the file.
    """
    path, where = request.path.resolve(), shown(request.path)
    try:
        with _without_ros(xacro, request):
            document = xacro.process_file(str(path), mappings=request.arguments, verbosity=0)
        text: str = document.toxml()
    except EqtError as error:
        raise EqtError(f"{where}: {error}") from None
    except Exception as error:
        cause: BaseException | None = error
        while cause is not None and not isinstance(cause, EqtError | MemoryError):
            cause = getattr(cause, "exc", None) or cause.__cause__ or cause.__context__
        if isinstance(cause, MemoryError):
            raise MemoryError from None
        if cause is not None:  # one of those above, which xacro has wrapped
            raise EqtError(f"{where}: {cause}") from None
        said = " ".join(str(error).split()) or type(error).__name__
        if lacks := re.search(r"substitution argument (\S+)|variable '?(\S+?)'? is not set", said):
            name = lacks[1] or lacks[2]
            hint = f"the argument '{name}' has no value; give it with --arg {name}=VALUE"
            raise EqtError(f"{where}: {hint}") from None
        raise EqtError(f"{where}: xacro: {said[:300]}; correct the file") from None
    if len(text) > MOST_BYTES:
        raise EqtError(f"{where}: expected at most {MOST_BYTES // 10**6} MB after its macros")
    return text


class _Names:
    """Follows names of files and packages into folders alone that they may lead to.

    Attributes
    ----------
    packages
        The folder of the file, and those of the packages that it has named.
    """

    def __init__(self, request: Request, absolute: Callable[[str], str]) -> None:
        self.request, self._absolute = request, absolute
        self.packages = [request.path.resolve().parent]

    def find(self, resolved: str, whole: str, arguments: list[str], _: Any) -> str:
        """Put the folder of a package in the place of ``$(find …)``."""
        self.packages.append(package(arguments[0], self.request))
        return resolved.replace(f"$({whole})", str(self.packages[-1]))

    def absolute(self, name: str) -> str:
        """Return the whole name of a file, or of a pattern, whose files are checked when read."""
        if Path(name).is_absolute() and not any(map(Path(name).is_relative_to, self.packages)):
            raise EqtError(f"{name}: expected a name relative to the file, or after $(find …)")
        path = Path(self._absolute(name))
        if path.exists():
            self.request.check_inside(path, "file", self.packages)
        return str(path)


@contextmanager
def _without_ros(xacro: Any, request: Request) -> Iterator[None]:
    """Let xacro find packages and files in folders, evaluate guarded expressions, and stop."""
    substitution = import_module("xacro.substitution_args")
    names = _Names(request, xacro.abs_filename_spec)
    calls, evaluate, call, parse = 0, xacro.safe_eval, xacro.handle_macro_call, xacro.parse

    def evaluated(expression: str, symbols: Any, *more: Any) -> Any:
        tree = _Guard().visit(ast.parse(expression.strip(), mode="eval"))
        return evaluate(ast.unparse(ast.fix_missing_locations(tree)), symbols, *more)

    def counted(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls > MOST_CALLS:
            raise EqtError(f"more than {MOST_CALLS} calls of macros")
        return call(*arguments)

    def parsed_file(text: Any, filename: Any = None) -> Any:
        if filename is not None:
            read(request.check_inside(Path(filename), "include", names.packages))
        return parse(text, filename)

    def refuse(*_: Any) -> str:
        raise EqtError("$(eval …) is not read; write ${…}")

    replaced = {
        (xacro, "safe_eval"): evaluated,
        (xacro, "handle_macro_call"): counted,
        (xacro, "parse"): parsed_file,
        (xacro, "abs_filename_spec"): names.absolute,
        (xacro, "warning"): lambda *_, **__: "",
        (xacro, "print_location"): lambda *_, **__: "",
        (substitution, "_find"): names.find,
        (substitution, "_eval"): refuse,
    }
    before = {(module, name): getattr(module, name) for module, name in replaced}
    symbols = dict(xacro._global_symbols)
    functions = xacro.NameSpace()
    functions.update({k: f for k, f in symbols["python"].items() if k not in _TYPES})
    functions["range"] = _range
    xacro._global_symbols |= {"guarded": _guarded, "range": _range, "python": functions}
    try:
        for (module, name), function in replaced.items():
            setattr(module, name, function)
        yield
    finally:
        xacro._global_symbols.clear()
        xacro._global_symbols.update(symbols)
        for (module, name), function in before.items():
            setattr(module, name, function)


def package(name: str, request: Request) -> Path:
    """Return the folder of a ROS package, which has its name or says it in package.xml.

    Raises
    ------
    EqtError
        If it is in no folder above the file, and in none of `--models`. Its name alone is enough
        beside the file; elsewhere, as of `/etc`, it has a package.xml.
    """
    path = request.path.resolve()
    above = path.parents
    for folder in (*above, *(parent.parent for parent in above[:3]), *request.models):
        for there in (folder, folder / name):
            by_name = there.name == name and (
                there in above or any(map(there.resolve().is_relative_to, request.folders))
            )
            if there.is_dir() and (by_name or _is_package(there, name)):
                return there.resolve()
    raise EqtError(
        f"$(find {name}): no folder of this package above the file; give --models DIR, the folder "
        "that has it"
    )


def _is_package(folder: Path, name: str) -> bool:
    described = folder / "package.xml"
    return described.is_file() and f"<name>{name}</name>".encode() in content(described)
