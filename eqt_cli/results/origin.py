"""What a result is of: laws, group, configuration, versions, and whether engines agreed."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import yaml

from eqt_cli.config.signal_path import loop_in_words
from eqt_cli.config.source import ConfigSource, source_of
from eqt_cli.config.yaml_source import dump
from eqt_cli.controllers import controllers
from eqt_cli.core.errors import ComponentError, EqtError, suggestion
from eqt_cli.core.printable import printable
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.experiment.config_at_point import config_at
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
        What redid the runs.
    runs
        How many runs of each controller.
    difference
        Largest max(‖ΔQ‖_F, ‖ΔV‖) over samples and over the runs that did not fail; inf where one
        of these fails when it is redone, NaN where all failed.
    bound
        What it should not exceed.
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
    """An open result that says what it is of.

    Labels, titles and all other texts are as they can be shown.
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
        """As `ResultFile.at`."""
        view = super().at(point, attributes)
        if self.has_groups:  # each says all of this anew
            check_attributes(view)
            check_coordinates(view)
        for kind in type(self).__mro__:
            for name, value in vars(kind).items():  # what was found out about the whole
                if isinstance(value, cached_property):
                    view.__dict__.pop(name, None)
        return view

    def point(self, point: int) -> Self:
        """One point of a sweep as the result of a single experiment, with its configuration.

        Raises
        ------
        ResultError
            If there is no such point.
        """
        view = self.at(point)
        attributes = {"title": f"{view.attributes['title']}, point {point}"}
        if not self.has_groups:  # which have a configuration each
            attributes["config"] = dump(config_at(source_of(self), point).data)
        return self.at(point, attributes)

    def error(self, message: str) -> EqtError:
        """An error about this result."""
        return EqtError(f"{self.path}: {message}")

    @property
    def title(self) -> str:
        """Of the experiment; the folder's name if the file says none."""
        return printable(str(self.attributes.get("title", self.path.parent.name)))

    @property
    def group_name(self) -> str:
        """The group; several of a sweep over groups; nothing if the file says none."""
        return printable(str(self.attributes.get("group", "")))

    @cached_property
    def group(self) -> MatrixLieGroup | None:
        """The group; None if it is of a plugin, which need not be loaded here."""
        with suppress(ComponentError):
            return group_named(self.group_name)
        return None

    @cached_property
    def labels(self) -> list[str]:
        """The labels of the controllers."""
        return [printable(str(label)) for label in self.coordinate("controller")]

    @cached_property
    def titles(self) -> list[str]:
        """How the controllers are written: by their laws' titles, or by the labels they have."""
        if titles := self._told("titles"):
            return [printable(titles.get(label, label)) for label in self.labels]
        return [law_title(label) for label in self.labels]

    @cached_property
    def titled(self) -> dict[str, str]:
        """`titles` by label: what tables and figures show for what a user types."""
        return dict(zip(self.labels, self.titles, strict=True))

    def label_of(self, name: str) -> str:
        """The label of the controller that a user names by it, or as tables write it: ``EqT``.

        A name that is neither is returned as it is.
        """
        return label_named(name, self.titled)

    def position_of(self, name: str) -> int:
        """Where the controller of this label or title stands.

        Raises
        ------
        EqtError
            If there is none.
        """
        label = self.label_of(name)
        if label not in self.labels:
            hint = suggestion(label, self.labels) or f"; there are: {', '.join(self.labels)}"
            raise self.error(f"holds no controller '{label}'{hint}")
        return self.labels.index(label)

    @cached_property
    def lyapunov_functions(self) -> dict[str, str]:
        """Which function L is, by label; empty where it is the same one for all."""
        found = self._told("lyapunov_functions").get("functions", {})
        return found if len(set(found.values())) > 1 else {}

    @cached_property
    def unclaimed(self) -> list[str]:
        """The labels of the laws that do not claim that their L falls."""
        return list(self._told("lyapunov_functions").get("unclaimed", []))

    @cached_property
    def without_function(self) -> list[str]:
        """The labels of laws that claim no decrease, beside laws that do so of their own L."""
        all_are = len(self.unclaimed) == len(self.labels)
        return self.unclaimed if self.lyapunov_functions and not all_are else []

    @cached_property
    def not_matched(self) -> list[str]:
        """The labels of laws whose stiffness and damping are not those of the gains."""
        return list(self._told("matching").get("not_matched", []))

    def _told(self, name: str) -> dict[str, Any]:
        """What an attribute holds as JSON; nothing in a file from before there was such a one."""
        return json.loads(str(self.attributes.get(name, "{}")))

    @cached_property
    def kinds(self) -> dict[str, str]:
        """The controller's kind by label, as the stored configuration has it; else the label."""
        with suppress(KeyError, TypeError):
            entries = self._config["controllers"]
            return {str(entry["label"]): str(entry["kind"]) for entry in entries}
        return {label: label for label in self.labels}

    @cached_property
    def loop_in_words(self) -> str:
        """What the loop has that the paper's has not, in a sentence; nothing for the paper's."""
        with suppress(KeyError, TypeError, AttributeError, ValueError):
            return loop_in_words(self._config or {})
        return ""

    @cached_property
    def _config(self) -> Any:
        """The stored configuration, of which nothing is checked; None if it is no YAML."""
        with suppress(yaml.YAMLError, RecursionError, ValueError):
            return yaml.safe_load(str(self.attributes.get("config", "")))
        return None

    @property
    def source(self) -> ConfigSource:
        """The stored configuration, with the plugins that it was run with."""
        return source_of(self)

    def experiment(self, *, trust_plugins: bool = False) -> Experiment:
        """The experiment that the result says it is of.

        Parameters
        ----------
        trust_plugins
            Execute the plugin sources that the file holds.

        Raises
        ------
        EqtError
            If it cannot be built, as without its plugins.
        """
        return build(self.source, trust_plugins=trust_plugins)

    @property
    def rtol(self) -> float | None:
        """The tolerance that all runs were asked for; None where it was swept, or is not known."""
        config = self._config if isinstance(self._config, dict) else {}
        solver = config.get("solver")
        swept = any(name.startswith("solver") for name in self.coordinates)
        rtol = solver.get("rtol") if isinstance(solver, dict) else None
        return rtol if isinstance(rtol, float) and not swept else None

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, machine and times, as the file has them; nothing where it has none."""
        return self._told("provenance")

    @property
    def cross_check(self) -> CrossCheck | None:
        """What came of the cross-check; None where there was none."""
        kept: Any = {name: self.attributes.get(f"cross_check_{name}") for name in CROSS_CHECK}
        return None if kept["method"] is None else CrossCheck(**kept)


def label_named(name: str, titled: Mapping[str, str]) -> str:
    """The label that a name is, or that has it as its title and is the only one; else the name."""
    found = [label for label, title in titled.items() if title == name]
    return found[0] if name not in titled and len(found) == 1 else name


def law_title(name: str) -> str:
    """How a law is written; its name where it is not registered here."""
    law = controllers.get(name) if name in controllers.names() else None
    return str(getattr(law, "title", name))
