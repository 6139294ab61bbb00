"""The base class of components, their registries, and the origin of their errors.

Components (groups, controllers, figures, …) are found by scanning modules; none is named here.
"""

from __future__ import annotations

import importlib
import inspect
import linecache
import re
import sys
import threading
import traceback
from abc import ABC
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property, lru_cache
from hashlib import sha256
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, ClassVar, Generic, TypeVar

from eqt_cli.base import extensions
from eqt_cli.base.code_files import modules_of, noted, united
from eqt_cli.base.errors import ComponentError, EqtError, EqtWarning, alike, bare, suggestion
from eqt_cli.base.files import refusals, text_in
from eqt_cli.base.reporting import reporter


def option_of_field(name: str) -> str:
    """Return the option of a field: `from` for ``from_``, because Python reserves the former."""
    return name.removesuffix("_")


class Keys:
    """Base of frozen dataclasses that a configuration writes as mappings, ``from_`` as `from`.

    No other keys, and no silent conversions: neither 1 for true nor text for a number.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {
        "extra": "forbid",
        "strict": True,
        "alias_generator": option_of_field,
    }

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Return a schema that is strict but for taking a mapping for the dataclass itself."""
        schema = handler(source)
        handler.resolve_ref_schema(schema)["strict"] = False
        return schema


class Component(Keys, ABC):
    """A dataclass whose fields are its options in a configuration.

    A component checks its options in `check`, and notes errors in the problems of its place:
    ``problems.at("std").add("expected …")``.
    """

    name: ClassVar[str]


T = TypeVar("T")

_PLUGIN = "eqt_plugin_"
"""Prefix of the module names of plugins."""

_registries: list[Registry] = []  # type: ignore[type-arg]  # registries of different bases
_loaded_plugins: dict[str, ModuleType] = {}
_code: dict[str, dict[str, str]] = {}
"""The hashes of the files that modules of components need, by the module."""


class Registry(Generic[T]):
    """The components of one kind, by name.

    Parameters
    ----------
    kind
        The word for a component in messages: ``"controller"``.
    plural
        The name of the kind in `eqt list`.
    base
        The class that every component derives from; plugins find it in `eqt_cli.extend`.
    modules
        The modules of eqt's own components, in the order in which a name is looked for. Extensions
        register theirs by `base.extensions`.
    note
        What a message on an unknown name says at its end.
    """

    def __init__(
        self, kind: str, plural: str, base: type[T], modules: tuple[str, ...], note: str = ""
    ) -> None:
        self.kind, self.plural, self.base, self.note = kind, plural, base, note
        self.modules = tuple(f"eqt_cli.{module}" for module in modules)
        self._plugins: dict[str, type[T]] = {}
        _registries.append(self)

    @lru_cache  # noqa: B019  # registries live as long as the process
    def _in_module(self, module: str) -> dict[str, type[T]]:
        components = self._components(importlib.import_module(module))
        return {_name(component): component for component in components}

    @cached_property
    def _of_extensions(self) -> dict[str, str]:
        """The modules of the components in extensions, which are imported when they are used."""
        return {
            name: module
            for extension in extensions.shipped()
            for name, module in extension.components.get(self.plural, {}).items()
        }

    @cached_property
    def _installed(self) -> dict[str, type[T]]:
        """The components of other distributions."""
        components: dict[str, type[T]] = {}
        of_eqt = {*map(_name, self.core()), *self._of_extensions}
        for extension in extensions.installed():
            for name, module in extension.components.get(self.plural, {}).items():
                where = f"{self.kind} '{name}' of the extension '{extension.name}'"
                if same := alike(name, of_eqt | components.keys()):
                    exists = f"{where} is left out: '{same}' already exists; rename yours"
                    reporter().remark(EqtWarning(exists))
                    continue
                try:
                    with noted(module, is_foreign) as files:
                        inside = self._in_module(module)
                    _code.setdefault(module, files)
                except EqtError:
                    raise
                except (Exception, SystemExit) as error:
                    raise ComponentError(
                        f"{where} cannot be loaded: {described(error)}; fix or uninstall the "
                        "distribution that declares it"
                    ) from error
                if name not in inside:
                    raise ComponentError(
                        f"{where} is not in {module}; define a class of this `name` there, derived "
                        f"from eqt_cli.extend.{self.base.__name__}"
                    )
                components[name] = inside[name]
        return components

    def _shipped(self, name: str) -> type[T] | None:
        """Return a component of eqt; modules behind the one that has it are not imported."""
        for module in self.modules:
            if component := self._in_module(module).get(name):
                return component
        if name in self._of_extensions:
            return self._in_module(self._of_extensions[name])[name]
        return None

    def _components(self, module: ModuleType) -> Iterator[type[T]]:
        for _, member in inspect.getmembers(module, inspect.isclass):
            is_defined_here = member.__module__ == module.__name__ and "name" in vars(member)
            if is_defined_here and issubclass(member, self.base):
                self._check_complete(member, f"{Path(str(module.__file__)).name}: ")
                yield member

    def _check_complete(self, component: type[T], where: str = "") -> None:
        missing = set(getattr(component, "__abstractmethods__", ()))
        for base in component.__mro__:  # class variables that a base declares without a value
            for name, kind in inspect.get_annotations(base).items():
                if "ClassVar" in str(kind) and not hasattr(component, name):
                    missing.add(name)
        if missing:
            raise ComponentError(
                f"{where}{self.kind} '{_name(component)}' does not define "
                f"{', '.join(sorted(missing))}; see eqt_cli.extend.{self.base.__name__}"
            )

    @property
    def _without_plugins(self) -> set[str]:
        """Names of the components of eqt, its extensions, and other distributions."""
        return {*map(_name, self.core()), *self._of_extensions, *self._installed}

    def names(self) -> list[str]:
        """Return all names, built-in and installed components first, plugins last, each sorted."""
        first = self._without_plugins
        return sorted(first) + sorted(set(self._plugins) - first)

    def get(self, name: str) -> type[T]:
        """Return the component called `name`.

        Raises
        ------
        ComponentError
            If there is none; the message names the closest, or else all components.
        """
        component = self._shipped(name) or self._installed.get(name) or self._plugins.get(name)
        if component is None:
            names = self.names()
            hint = suggestion(name, names) or f"; known: {', '.join(names)}"
            raise ComponentError(f"unknown {self.kind} '{name}'{hint}{self.note}")
        return component

    def written(self, name: str) -> str:
        """Return the name of the component that a person calls `name`: gt of GT, else `name`."""
        if self._shipped(name) or name in (names := self.names()):  # the first imports no other
            return name
        return next((same for same in names if bare(same) == bare(name)), name)

    def core(self) -> list[type[T]]:
        """Return the components of eqt itself, without extensions and other distributions."""
        return [kind for module in self.modules for kind in self._in_module(module).values()]

    def all(self) -> list[type[T]]:
        """Return every component, in the order of `names`."""
        return [self.get(name) for name in self.names()]

    def defined_by(self, texts: Iterable[str]) -> list[str]:
        """Return the names of the components that the texts of plugins define."""
        modules = {_module_name(sha256(text.encode()).hexdigest()) for text in texts}
        return [name for name, kind in self._plugins.items() if kind.__module__ in modules]

    def add_from(self, module: ModuleType, source: str) -> list[str]:
        """Register the components that a plugin module defines, and return their names."""
        added = []
        for component in self._components(module):
            name = _name(component)
            if same := alike(name, self._without_plugins):
                but = f", in other capitals ('{same}')" if same != name else ""
                raise ComponentError(
                    f"plugin {source}: {self.kind} '{name}' already exists in eqt{but}; "
                    "give yours another name"
                )
            self._plugins[name] = component
            added.append(name)
        return added


def load_plugin(path: Path, source: str | None = None) -> list[str]:
    """Execute a plugin file and register every component in it.

    The same text is executed only once. If another text has taken over its names since, they are
    registered again. `source` replaces the file's text, for a plugin kept inside a result.

    Returns
    -------
    list of str
        The registered components, as ``controller 'mine'``.

    Raises
    ------
    ComponentError
        If the file cannot be read, fails when executed, or defines no component.
    """
    with refusals(f"plugin {path}", "read", kind=ComponentError):
        text = text_in(path) if source is None else source
    digest = sha256(text.encode()).hexdigest()
    if (module := _loaded_plugins.get(digest)) is None:
        module = ModuleType(_module_name(digest))
        module.__file__ = str(path)
        sys.modules[module.__name__] = module  # dataclasses look their module up there
        threading.excepthook = _note_exit
        try:
            with noted(module.__name__, is_foreign, text) as files:
                exec(compile(text, str(path), "exec"), module.__dict__)
            _code[module.__name__] = files
        except (Exception, SystemExit) as error:
            cure = ""
            if isinstance(error, FileNotFoundError):
                cure = "; put the file there; results copy plugins, but no file that they read"
            raise ComponentError(f"plugin {path}: {described(error)}{cure}") from error
    # Messages quote lines of the text, even where the file is another one or does not exist.
    name = str(module.__file__)
    linecache.cache[name] = len(text), None, text.splitlines(keepends=True), name
    added = [
        f"{registry.kind} '{name}'"
        for registry in _registries
        for name in registry.add_from(module, path.name)
    ]
    if not added:
        bases = ", ".join(sorted(registry.base.__name__ for registry in _registries))
        raise ComponentError(
            f"plugin {path}: defines no component; derive a class with a `name` from one of {bases}"
        )
    _loaded_plugins[digest] = module
    return added


def code_of(texts: Iterable[str], *parts: Any) -> dict[str, str]:
    """Return the hashes of the files that decide what plugins and parts of an experiment compute.

    The plugins themselves are left out. A part may name more in `sources`.
    """
    named = {_module_name(sha256(text.encode()).hexdigest()): text for text in texts}
    files, seen = [_code.get(name, {}) for name in named], set[int]()
    # Where a law was tried, its functions have imported what they need.
    files += [modules_of(name, text, in_functions=True) for name, text in named.items()]
    waiting = list(parts)
    while waiting:
        part = waiting.pop()
        if isinstance(part, dict | list | tuple):
            waiting += part.values() if isinstance(part, dict) else part
        elif hasattr(part, "__dataclass_fields__") and id(part) not in seen:
            seen.add(id(part))
            files += _code.get(type(part).__module__, {}), getattr(part, "sources", {})
            waiting += vars(part).values()
    return united(files)


def _module_name(digest: str) -> str:
    return f"{_PLUGIN}{digest[:12]}"


def is_plugin(module: str) -> bool:
    """Whether a module is the file of a plugin."""
    return module.startswith(_PLUGIN)


def is_foreign(module: str) -> bool:
    """Whether a module is a plugin, or belongs to a distribution that declares components."""
    package = module.partition(".")[0]
    return is_plugin(module) or (package != "eqt_cli" and package in _foreign_packages())


@lru_cache(maxsize=1)
def _foreign_packages() -> frozenset[str]:
    packages = (extension.package for extension in extensions.installed())
    return frozenset(package.partition(".")[0] for package in packages)


def _name(component: type) -> str:
    return str(component.name)  # type: ignore[attr-defined]  # `_components` asks for it


def summary(component: type) -> str:
    """Return the first line of a component's docstring, as in `eqt list`."""
    return (inspect.getdoc(component) or "").partition("\n")[0]


def description(component: type) -> str:
    """Return a component's docstring before its attributes, as running text."""
    text = (inspect.getdoc(component) or "").partition("\n\nAttributes\n")[0]
    return " ".join(text.replace("`", "").split())


def meanings(component: type) -> dict[str, str]:
    """Return the text on each attribute in the docstrings of a class and its bases."""
    texts: dict[str, str] = {}
    for owner in reversed(component.__mro__):
        doc = inspect.cleandoc(owner.__doc__ or "")
        section = re.search(r"Attributes\n-+\n(.*?)(?:\n\n\S|\Z)", doc, re.DOTALL)
        attributes = section[1] + "\n" if section else ""
        for names, text in re.findall(r"^(\S[^\n]*)\n((?:    [^\n]*\n?|\n)+)", attributes, re.M):
            for name in names.partition(" : ")[0].split(", "):
                texts[name] = " ".join(text.split())
    return texts


def place_of(error: BaseException, is_component: Callable[[str], bool] = is_foreign) -> str | None:
    """Return the innermost line of a plugin, ``law.py:9: return 1 / 0``; None if there is none.

    Lines of libraries are skipped, because a library may fail by what a component passes to it.

    Parameters
    ----------
    is_component
        Whether the lines of a module count.
    """
    place = None
    for frame, line in traceback.walk_tb(error.__traceback__):
        if is_component(str(frame.f_globals.get("__name__", ""))):
            code = frame.f_code
            source = traceback.FrameSummary(code.co_filename, line, code.co_name).line
            place = f"{Path(code.co_filename).name}:{line}" + (f": {source}" if source else "")
    return place


def place_of_function(function: object) -> str:
    """Return where a function is defined, ``law.py:8``."""
    if not isinstance(function, FunctionType):
        return repr(function)
    return f"{Path(function.__code__.co_filename).name}:{function.__code__.co_firstlineno}"


def described(error: BaseException) -> str:
    """Return type and message of an error on one line, ``ZeroDivisionError: division by zero``."""
    if isinstance(error, SystemExit):
        return f"SystemExit: calls exit({error.code!r}), which would end eqt"
    return " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")


@contextmanager
def blamed() -> Iterator[None]:
    """Turn an exception in a plugin into an error with its line.

    Raises
    ------
    ComponentError
        In place of the exception.
    """
    ends = len(_ends_of_threads)
    try:
        yield
    except EqtError:
        raise
    except (Exception, SystemExit) as error:
        place = place_of(error)
        if place is None:
            raise
        raise ComponentError(f"{described(error)} at {place}") from error
    if len(_ends_of_threads) > ends:
        raise ComponentError(f"a thread that a plugin started ends by {_ends_of_threads[-1]}")


_ends_of_threads: list[str] = []
"""How threads ended that called `exit`, of which Python says nothing."""

_hook_of_threads = threading.excepthook


def _note_exit(end: threading.ExceptHookArgs) -> None:
    if isinstance(end.exc_value, SystemExit):
        place = place_of(end.exc_value)
        _ends_of_threads.append(described(end.exc_value) + (f" at {place}" if place else ""))
    else:
        _hook_of_threads(end)


def registry(kind: str) -> Registry[Any]:
    """Return the registry of a kind, by its plural."""
    importlib.import_module(extensions.all_kinds()[kind])
    return next(registry for registry in _registries if registry.plural == kind)
