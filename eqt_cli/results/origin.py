"""The origin of a result: laws, group, configuration, versions, and cross-check."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from eqt_cli.config.signal_path import loop_in_words
from eqt_cli.config.source import ConfigSource, source_of
from eqt_cli.config.yaml_source import dump, load
from eqt_cli.controllers import controllers
from eqt_cli.core.errors import ComponentError, ConfigError, EqtError, suggestion
from eqt_cli.core.printable import printable
from eqt_cli.experiment.build import build
from eqt_cli.experiment.config_at_point import config_at
from eqt_cli.experiment.experiment import Experiment, told_apart
from eqt_cli.groups import MatrixLieGroup, group_named
from eqt_cli.results.contract import CROSS_CHECK, check_attributes, check_coordinates
from eqt_cli.store.reader import ResultFile
from eqt_cli.store.table import Attribute


@dataclass(frozen=True)
class CrossCheck:
    """The outcome of a cross-check.

    Attributes
    ----------
    method
        Description of the engine that repeated the runs.
    runs
        Number of runs of each controller.
    difference
        Largest max(‖ΔQ‖_F, ‖ΔV‖) over samples and over the runs that did not fail; inf if one of
        these fails in the repetition, NaN if all runs failed.
    bound
        Allowed difference.
    """

    method: str
    runs: int
    difference: float
    bound: float

    @property
    def holds(self) -> bool:
        """Whether the difference is within the bound."""
        return not self.difference > self.bound


class KnownResult(ResultFile):
    """An open result that describes its origin.

    Labels, titles and all other texts are safe to display.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        try:
            check_attributes(self)
            check_coordinates(self)
        except BaseException:
            self.close()
            raise

    def at(self, point: int, attributes: Mapping[str, Attribute] | None = None) -> Self:
        """Return a view of one point, as `ResultFile.at`."""
        view = super().at(point, attributes)
        if self.has_groups:  # each group has its own attributes and coordinates
            check_attributes(view)
            check_coordinates(view)
        for kind in type(self).__mro__:
            for name, value in vars(kind).items():  # drop cached values of the whole result
                if isinstance(value, cached_property):
                    view.__dict__.pop(name, None)
        return view

    def point(self, point: int) -> Self:
        """Return a point of a sweep as the result of a single experiment with its configuration.

        Raises
        ------
        ResultError
            If there is no such point.
        """
        view = self.at(point)
        attributes = {"title": f"{view.attributes['title']}, point {point}"}
        if not self.has_groups:  # else each group has its configuration
            attributes["config"] = dump(config_at(source_of(self), point).data)
        return self.at(point, attributes)

    def error(self, message: str) -> EqtError:
        """Return an error about this result."""
        return EqtError(f"{self.path}: {message}")

    @property
    def title(self) -> str:
        """Name of the experiment; the folder's name if the file has none."""
        return printable(str(self.attributes.get("title", self.path.parent.name)))

    @property
    def group_name(self) -> str:
        """Name of the group, or of the groups of a sweep; empty if the file has none."""
        return printable(str(self.attributes.get("group", "")))

    @cached_property
    def group(self) -> MatrixLieGroup | None:
        """The group; None if it comes from a plugin that is not loaded."""
        with suppress(ComponentError):
            return group_named(self.group_name)
        return None

    @cached_property
    def labels(self) -> list[str]:
        """Labels of the controllers."""
        return [printable(str(label)) for label in self.coordinate("controller")]

    given_names: Mapping[str, str] = MappingProxyType({})
    """User's titles of laws and quantities, by label and name."""

    def rename(self, names: Mapping[str, str]) -> list[str]:
        """Call laws and quantities otherwise, in figures and tables; those that are not here.

        Parameters
        ----------
        names
            By a law's label or title, or by the name of a quantity.
        """
        found = {self.label_of(name): printable(given) for name, given in names.items()}
        self.given_names = found
        for name in ("titles", "titled"):
            vars(self).pop(name, None)
        return [
            name
            for name, known in zip(names, found, strict=True)
            if known not in self.labels and not self.knows(known)
        ]

    def knows(self, name: str) -> bool:
        """Whether it is the name of a quantity of this result."""
        return self.has(name)

    @cached_property
    def titles(self) -> list[str]:
        """Display names of the controllers: given by the user, titles of their laws, or labels.

        Labels where several laws have one title.
        """
        given = {k: name for k, name in self.given_names.items() if k in self.labels}
        return list(told_apart(self._own_titles | given).values())

    @cached_property
    def _own_titles(self) -> dict[str, str]:
        """Titles of the laws by label, without the names that a user gives."""
        told = self._json("titles")
        return told_apart(
            {
                label: printable(told.get(label, label) if told else law_title(label))
                for label in self.labels
            }
        )

    @cached_property
    def titled(self) -> dict[str, str]:
        """Display names by label."""
        return dict(zip(self.labels, self.titles, strict=True))

    def label_of(self, name: str) -> str:
        """Return the label of a controller, given its label or its display name: ``EqT``.

        Any other name is returned unchanged.
        """
        found = label_named(name, self.titled)
        return found if found in self.labels else label_named(name, self._own_titles)

    def position_of(self, name: str) -> int:
        """Return the index of the controller with this label or display name.

        Raises
        ------
        EqtError
            If there is no such controller.
        """
        label = self.label_of(name)
        if label not in self.labels:
            hint = suggestion(label, self.labels) or f"; there are: {', '.join(self.labels)}"
            raise self.error(f"holds no controller '{label}'{hint}")
        return self.labels.index(label)

    @cached_property
    def lyapunov_functions(self) -> dict[str, str]:
        """Name of each law's function L, by label; empty if it is the same for all."""
        found = self._json("lyapunov_functions").get("functions", {})
        return found if len(set(found.values())) > 1 else {}

    @cached_property
    def unclaimed(self) -> list[str]:
        """Labels of the laws that do not claim that their L decreases."""
        return list(self._json("lyapunov_functions").get("unclaimed", []))

    @cached_property
    def without_function(self) -> list[str]:
        """Labels of laws that claim no decrease, if other laws claim it for their own L."""
        all_are = len(self.unclaimed) == len(self.labels)
        return self.unclaimed if self.lyapunov_functions and not all_are else []

    @cached_property
    def not_matched(self) -> list[str]:
        """Labels of laws whose stiffness and damping are not those of the gains."""
        return list(self._json("matching").get("not_matched", []))

    def _json(self, name: str) -> dict[str, Any]:
        """Return the JSON data of an attribute; empty if the file does not have it."""
        return json.loads(str(self.attributes.get(name, "{}")))

    @cached_property
    def kinds(self) -> dict[str, str]:
        """Kind of each controller by label, from the stored configuration; else the label."""
        with suppress(KeyError, TypeError):
            entries = self.config["controllers"]
            return {str(entry["label"]): str(entry["kind"]) for entry in entries}
        return {label: label for label in self.labels}

    @cached_property
    def loop_in_words(self) -> str:
        """Sentence about parts of the loop that the paper's loop does not have; may be empty."""
        with suppress(KeyError, TypeError, AttributeError, ValueError):
            return loop_in_words(self.config)
        return ""

    @cached_property
    def config(self) -> dict[str, Any]:
        """The stored configuration without any checks; empty if it cannot be read."""
        with suppress(ConfigError):
            return load(str(self.attributes.get("config", "")), "config").data
        return {}

    @property
    def source(self) -> ConfigSource:
        """The stored configuration with the stored plugins."""
        return source_of(self)

    def experiment(self, *, trust_plugins: bool = False) -> Experiment:
        """Build the experiment from the stored configuration.

        Parameters
        ----------
        trust_plugins
            Whether to execute the plugin sources that the file holds.

        Raises
        ------
        EqtError
            If it cannot be built, for example without its plugins.
        """
        return build(self.source, trust_plugins=trust_plugins)

    @property
    def rtol(self) -> float | None:
        """Relative tolerance of all runs; None if it was swept or is unknown."""
        solver = self.config.get("solver")
        swept = any(name.startswith("solver") for name in self.coordinates)
        rtol = solver.get("rtol") if isinstance(solver, dict) else None
        return rtol if isinstance(rtol, float) and not swept else None

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine and times from the file; empty if it has none."""
        return self._json("provenance")

    @property
    def cross_check(self) -> CrossCheck | None:
        """Outcome of the cross-check; None if there was none."""
        kept: Any = {name: self.attributes.get(f"cross_check_{name}") for name in CROSS_CHECK}
        return None if kept["method"] is None else CrossCheck(**kept)


def label_named(name: str, titled: Mapping[str, str]) -> str:
    """Return the label for a label or a unique display name; any other name is returned."""
    found = [label for label, title in titled.items() if title == name]
    return found[0] if name not in titled and len(found) == 1 else name


def law_title(name: str) -> str:
    """Return the display name of a law; its name if it is not registered."""
    law = controllers.get(name) if name in controllers.names() else None
    return str(getattr(law, "title", name))
