"""Extensions: packages in `eqt_cli/extensions`, and distributions that extend eqt in the same way.

Each has a function ``register(extension)``, which names what the package adds and where that is;
its code is imported where a command uses it. Those of eqt are found in the folder, others by an
entry point of the group ``eqt.extensions``.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

from eqt_cli.base.errors import ComponentError, EqtWarning, suggestion
from eqt_cli.base.reporting import reporter

GROUP = "eqt.extensions"
"""Group of the entry points of other distributions."""

START = "Start here"
COMPUTE = "Compute"
READ = "Look at results"
LOOK_UP = "Configurations, recordings and components"
"""Panels of the help, in which commands stand."""


_KINDS = {
    "groups": "eqt_cli.components.groups",
    "controllers": "eqt_cli.components.laws",
    "references": "eqt_cli.components.references",
    "forces": "eqt_cli.components.forces",
    "actuators": "eqt_cli.components.actuators",
    "sensors": "eqt_cli.components.sensors",
    "estimators": "eqt_cli.components.estimators",
    "engines": "eqt_cli.engines.engine",
    "poses": "eqt_cli.components.initial_states",
    "velocities": "eqt_cli.components.initial_states",
    "metrics": "eqt_cli.loop.signals",
    "designs": "eqt_cli.config.designs",
    "executors": "eqt_cli.runs.executors",
    "figures": "eqt_cli.figures.figure",
}
"""The modules of the registries of components, but for those of extensions and of claims."""


class CommandPlace(NamedTuple):
    """Where a command is.

    Attributes
    ----------
    function
        Its function, or the app of a group of commands, as ``package.module.name``.
    panel
        The panel of the help in which it stands.
    example
        The arguments of its example.
    after
        The command that it follows in its panel; "" for the last one.
    """

    function: str
    panel: str
    example: str
    after: str = ""


P = ParamSpec("P")
R = TypeVar("R")


class Purpose(Generic[P, R]):
    """What other code asks extensions for: a signature, with a sentence; `base/purposes.py`.

    Called with a function that an extension has for it, it returns the function as it is: so that
    the checker of types compares both signatures.

    Parameters
    ----------
    signature
        A function without a body, whose docstring says what it returns and who asks.
    name
        The words of a message where no extension has a function. Default: the function's name.
    """

    def __init__(self, signature: Callable[P, R], name: str = "") -> None:
        self.signature = signature
        self.name = name or signature.__name__.replace("_", " ")

    def __call__(self, function: Callable[P, R]) -> Callable[P, R]:
        """Return a function for this purpose, and note the purpose in it."""
        function.purpose = self  # type: ignore[attr-defined]
        return function


class One(Purpose[P, R]):
    """What one extension of eqt does, and without which a command refuses."""


class Every(Purpose[P, R]):
    """What any number of extensions may have."""


def one(name: str) -> Callable[[Callable[P, R]], One[P, R]]:
    """Make a signature the purpose of one extension, with its name in messages."""
    return lambda signature: One(signature, name)


def every(signature: Callable[P, R]) -> Every[P, R]:
    """Make a signature a purpose of any number of extensions."""
    return Every(signature)


class FunctionPlace(NamedTuple):
    """Where a function for a purpose is.

    Attributes
    ----------
    purpose, function
        The purpose, and the function as ``package.module.name``.
    beside
        A file: the function is for results in a folder that has it.
    key
        The word by which the function is asked for, of a purpose whose functions differ.
    about
        Modules of components: the function has something to say only where one is imported.
    """

    purpose: Purpose[..., Any]
    function: str
    beside: str = ""
    key: str = ""
    about: Sequence[str] = ()


class Extension:
    """What one package adds to eqt; places are relative to it, ``module.name``.

    Parameters
    ----------
    name
        Its name in messages.
    package
        The package of its modules.
    """

    def __init__(self, name: str, package: str) -> None:
        self.name, self.package = name, package
        self.kinds: dict[str, str] = {}
        self.components: dict[str, dict[str, str]] = {}
        self.commands: dict[str, CommandPlace] = {}
        self.functions: list[FunctionPlace] = []
        self.needs: set[str] = set()
        self.keys: list[str] = []

    def need(self, name: str) -> None:
        """Name an extension of eqt that this one imports; without it, this one is left out."""
        self.needs.add(name)

    def add_kind(self, kind: str, module: str) -> None:
        """Name the module of the registry of a kind of components, by its plural."""
        self.kinds[kind] = f"{self.package}.{module}"

    def add_keys(self, place: str) -> None:
        """Name a class whose fields are keys of a configuration, a `eqt_cli.extend.Section`."""
        self.keys.append(f"{self.package}.{place}")

    def add_component(self, kind: str, name: str, module: str = "") -> None:
        """Name a component by the plural of its kind, ``controllers``, and its module.

        Without a module, it is in the package itself.
        """
        self.components.setdefault(kind, {})[name] = f"{self.package}.{module}".rstrip(".")

    def add_command(
        self, name: str, function: str, panel: str = READ, example: str = "", after: str = ""
    ) -> None:
        """Name the function of a command, as `CommandPlace` describes."""
        self.commands[name] = CommandPlace(f"{self.package}.{function}", panel, example, after)

    def add_function(
        self,
        purpose: Purpose[..., Any],
        function: str,
        beside: str = "",
        key: str = "",
        about: Sequence[str] = (),
    ) -> None:
        """Name a function for a purpose of `eqt_cli.base.purposes`, as `FunctionPlace` says."""
        places = [f"{self.package}.{place}" for place in (function, *about)]
        self.functions.append(FunctionPlace(purpose, places[0], beside, key, places[1:]))


@lru_cache(maxsize=1)
def shipped() -> tuple[Extension, ...]:
    """Return the extensions in the folder, by name, but for those that need an absent one."""
    folder = Path(__file__).parents[1] / "extensions"
    extensions = []
    for name in sorted(module.name for module in pkgutil.iter_modules([str(folder)])):
        extensions.append(Extension(name, f"eqt_cli.extensions.{name}"))
        importlib.import_module(extensions[-1].package).register(extensions[-1])
    names = {extension.name for extension in extensions}
    return tuple(extension for extension in extensions if extension.needs <= names)


@lru_cache(maxsize=1)
def all_kinds() -> dict[str, str]:
    """Return the module of the registry of each kind by its plural, as `eqt list` sorts them."""
    modules = dict(_KINDS)
    for extension in shipped():
        modules |= extension.kinds
    return {**modules, "claims": "eqt_cli.analysis.claims"}


@lru_cache(maxsize=1)
def installed() -> tuple[Extension, ...]:
    """Return the extensions of other distributions.

    Raises
    ------
    ComponentError
        If one cannot be loaded.
    """
    # A look at the files takes 2 ms, the import of importlib.metadata 20.
    files = (file for folder in sys.path for file in Path(folder).glob("*-info/entry_points.txt"))
    if not any(_mentions(file) for file in files):
        return ()
    from importlib.metadata import entry_points

    extensions = []
    for point in entry_points(group=GROUP):
        extensions.append(Extension(point.name, point.module))
        try:
            point.load()(extensions[-1])
            for kind in extensions[-1].components.keys() - all_kinds():
                raise ComponentError(f"unknown kind '{kind}'{suggestion(kind, all_kinds())}")
        except (Exception, SystemExit) as error:
            raise ComponentError(
                f"extension '{point.name}' of the entry point '{point.value}' cannot be loaded: "
                f"{error}; fix or uninstall the distribution that declares it"
            ) from error
    return tuple(extensions)


def _mentions(file: Path) -> bool:
    with suppress(OSError):  # of a file that nobody may read
        return file.is_file() and GROUP.encode() in file.read_bytes()
    return False


@lru_cache(maxsize=1)
def usable() -> tuple[Extension, ...]:
    """Return all extensions; only eqt's, with a remark, if another one cannot be loaded."""
    try:
        return *shipped(), *installed()
    except ComponentError as error:
        reporter().remark(EqtWarning(str(error)))
        return shipped()


def imported(place: str) -> Any:
    """Import an object by its place, ``package.module.name``."""
    module, _, name = place.rpartition(".")
    return getattr(importlib.import_module(module), name)


def functions_for(
    purpose: Purpose[P, R],
    folder: Path | None = None,
    *,
    key: str = "",
    among: Iterable[Extension] | None = None,
) -> Iterator[Callable[P, R]]:
    """Import the functions that extensions have for a purpose, those of eqt first.

    Those that are named ``beside`` a file are for results in a `folder` that has this file.
    """
    for extension in usable() if among is None else among:
        for place in extension.functions:
            absent = bool(place.beside and folder and not (folder / place.beside).exists())
            absent |= bool(place.about) and not {*place.about} & sys.modules.keys()
            if place.purpose is purpose and place.key == key and not absent:
                yield imported(place.function)


def function_for(purpose: One[P, R]) -> Callable[P, R]:
    """Import the function for what one extension of eqt does, such as ``compare --measured``.

    Raises
    ------
    ComponentError
        If the extension was removed.
    """
    for function in functions_for(purpose, among=shipped()):
        return function
    raise ComponentError(f"{purpose.name}: its extension is not installed; install eqt again")


# Modules with many names, each imported when it is used -------------------------------------------


def places(module: str) -> dict[str, str]:
    """Return the module of each name that the stub beside a module imports.

    ``*`` stands for the names in a stub of an extension, if it is there.
    """
    return _listed(Path(str(sys.modules[module].__file__)).with_suffix(".pyi"))


def _listed(stub: Path) -> dict[str, str]:
    import ast

    modules: dict[str, str] = {}
    names = {extension.package for extension in shipped()}
    for statement in ast.parse(stub.read_text("utf-8")).body:
        if isinstance(statement, ast.ImportFrom):
            module = str(statement.module)
            if statement.names[0].name == "*":
                place = Path(__file__).parents[2].joinpath(*module.split("."))
                extension = place / "__init__.pyi" if place.is_dir() else place.with_suffix(".pyi")
                modules |= _listed(extension) if ".".join(module.split(".")[:3]) in names else {}
            else:
                modules |= dict.fromkeys((alias.name for alias in statement.names), module)
    return modules


def lazily(module: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__all__``, ``__getattr__`` and ``__dir__`` of a module by the stub beside it."""
    itself, modules = sys.modules[module], places(module)

    def imported(name: str) -> Any:
        """Return the object of a name, and import its module, for example Matplotlib, only now."""
        if name not in modules:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(modules[name]), name)
        setattr(itself, name, value)
        return value

    return sorted(modules), imported, lambda: sorted({*vars(itself), *modules})
