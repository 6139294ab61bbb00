"""Compares laws and results."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from eqt_cli.analysis.intervals import NEGLIGIBLE, Resampling
from eqt_cli.api.loading import ResultPath, open_at, path_from, require_list
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, Remedy, suggestion
from eqt_cli.base.extensions import function_for
from eqt_cli.results.conclusion import conclusion_of, words_of
from eqt_cli.results.quantity import Window
from eqt_cli.results.result import Result, open_result

if TYPE_CHECKING:
    from eqt_cli.analysis.comparison import Comparison
    from eqt_cli.analysis.maps import Map

# Each function imports the analysis that it needs: together they take half a second.


def compare(
    result: str | os.PathLike[str],
    metrics: Sequence[str] = (),
    windows: Sequence[str | Window] = (),
    *,
    other: ResultPath | None = None,
    fail_on: Sequence[str] | None = None,
    law: Mapping[str, str] | None = None,
    same: Sequence[str] = (),
    controllers: Sequence[str] = (),
    without_start: bool = False,
    point: int | None = None,
    units: Sequence[str] = (),
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
    sequential: bool = False,
    negligible: float = NEGLIGIBLE,
) -> Comparison:
    """Compare the laws of a result, or the laws of another result with them, run by run.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of metrics, as ``eqt compare RESULT --list`` shows them; a default selection if empty.
    windows
        Time windows in seconds, as ``"0:5"``.
    other
        Another result, such as one with other gains, whose laws are compared with the same laws of
        the first.
    fail_on
        What the other result must not have: ``"effort worse by 5 %"``, ``"worse"``, ``"failed"``.
        Then ``gate`` of the comparison says of each law what holds, and what is not shown.
    law
        Laws of the other result, and those of the first that they are compared with, where their
        names differ.
    same
        Sections of the configuration that must be equal in both results.
    controllers
        Labels or titles of the controllers to compare; all if empty.
    without_start
        Whether to leave out the starting gains of a tuning.
    point
        Point of a sweep, counted from 0.
    units
        ``"mN m"`` for every quantity of this dimension, or ``"mean_torque=mN m"`` for one.
    confidence, resamples, seed
        Settings of the bootstrap.
    sequential
        Whether words and gates hold at every look, so that runs may be added until they decide.
    negligible
        Relative difference that counts as none.

    Returns
    -------
    Comparison
        Means of each controller, differences of each pair, and verdicts on claims.

    Raises
    ------
    EqtError
        If the result does not have a metric or a window, or a gate cannot compare the results.

    Examples
    --------
    >>> comparison = eqt_cli.compare("results/paper", ["mean_torque"], ["0:5"])
    >>> [(pair.first, pair.second) for pair in comparison.pairs][:2]
    [('gt', 'eqt'), ('nog', 'eqt')]
    """
    from eqt_cli.analysis.compare import compare as compare_results

    for name, names in (("metrics", metrics), ("fail_on", fail_on or ()), ("same", same)):
        require_list(name, names)
    if other is None and (fail_on is not None or law or same):
        raise EqtError("fail_on, law and same compare two results; give other, too")
    how = Resampling(confidence, resamples, seed, sequential)
    with open_at(path_from("result", result), point) as opened:
        before, over = (
            opened.in_units(units),
            _windows(windows, words_of(opened).get("windows") or {}),
        )
        compared = partial(
            compare_results, metrics=metrics, windows=over, how=how, negligible=negligible
        )
        if other is None:
            chosen = chosen_labels(before, controllers, without_start=without_start)
            return compared(before, labels=chosen)
        with open_at(path_from("other", other), point) as second:
            now, gate = second.in_units(units), None
            _require_same(opened, second, same)
            pairs = _counterparts(
                opened, second, law or {}, controllers, all_needed=fail_on is not None
            )
            if fail_on is not None:
                gate = function_for(purposes.compare_fail_on)(fail_on, before, now, over)
            between = _between(opened, second)
            both = compared(before, now, between=between, counterparts=pairs)
            return replace(both, gate=gate(both, pairs)) if gate else both


def _windows(windows: Sequence[str | Window], named: Mapping[str, Any]) -> list[Window]:
    """Return windows, some of which may be named in the configuration of a result."""
    if isinstance(windows, str | Window):
        raise EqtError(f"windows: expected a list of windows, as ['0:5'], got {windows!r}")
    for window in windows:
        if not isinstance(window, str | Window):
            raise EqtError(f"windows: expected text such as '0:5', or a Window, got {window!r}")
    texts = {
        name: f"{ends.get('start') or 0}:{ends.get('stop') or ''}" for name, ends in named.items()
    }
    return [
        Window.parse(texts.get(window, window)) if isinstance(window, str) else window
        for window in windows
    ]


def _counterparts(
    first: Result,
    second: Result,
    named: Mapping[str, str],
    controllers: Sequence[str],
    *,
    all_needed: bool,
) -> dict[str, str]:
    """Return the law of the first result for each law of the second, or for some controllers.

    A law without a counterpart is compared with the first law, unless `all_needed`.
    """
    pairs = {law: law for law in second.labels}
    for law, base in named.items():
        pairs[second.labels[second.position_of(law)]] = first.labels[first.position_of(base)]
    if controllers:
        chosen = [second.labels[second.position_of(name)] for name in controllers]
        pairs = {law: pairs[law] for law in chosen}
    laws = [*pairs.values()]
    lacking = [(first, law) for law in laws if law not in first.labels]
    lacking += [(second, law) for law in first.labels if not controllers and law not in laws]
    if all_needed:
        for result, law in lacking:
            remedies = [Remedy("pair laws with {} NEW=OLD", "law")]
            remedies.append(Remedy("choose laws with {}", "controller"))
            raise EqtError(f"{result.path}: holds no law '{law}', the other result does", *remedies)
    return {law: base if base in first.labels else first.labels[0] for law, base in pairs.items()}


_STORED = {
    "initial": ("initial_pose", "initial_velocity"),
    "reference": ("desired_pose", "desired_velocity"),
}
"""What results store of a section."""


def _require_same(first: Result, second: Result, sections: Sequence[str]) -> None:
    """Refuse results that differ in these sections of the configuration.

    Raises
    ------
    EqtError
        If they differ, or if there is no such section.
    """
    from eqt_cli.analysis.differences import changed_keys
    from eqt_cli.config.schema import Config

    for section in sections:
        if section not in Config.model_fields:
            raise EqtError(f"no section '{section}'{suggestion(section, Config.model_fields)}")
        changes = [change["key"] for change in changed_keys(first, second)]
        changed = [key for key in changes if key.partition(".")[0] == section]
        if changed or not _agree(first, second, _STORED.get(section, ())):
            what = ", ".join(changed) or "its values"
            raise second.error(f"'{section}' differs from {first.path} in {what}")


def _agree(first: Result, second: Result, names: Sequence[str]) -> bool:
    """Whether both results store equal numbers of these names, of the runs that both have."""
    runs = slice(min(first.runs, second.runs))
    for name in (x for x in names if first.has(x) and second.has(x)):
        some = {"run": runs} if "run" in first.dims(name) else {}
        one, other = (result.read(name, **some) for result in (first, second))
        if one.shape != other.shape or not np.allclose(one, other, ROUNDED, ROUNDED):
            return False
    return True


def _between(first: Result, second: Result) -> list[str]:
    """Say whether the runs of two results are pairs, and what differs between the results."""
    from eqt_cli.analysis.differences import changed_files, changed_keys

    paired = _agree(first, second, _STORED["initial"])
    changes = [
        f"{change['key']} {change.get('first', '-')} → {change.get('second', '-')}"
        for change in changed_keys(first, second)
    ]
    changes += [f"file {name}" for name in changed_files(first, second)]
    if len(changes) > MOST_CHANGES:
        changes[MOST_CHANGES:] = [f"{len(changes) - MOST_CHANGES} more (`eqt diff`)"]
    versions = [str(result.provenance.get("eqt")) for result in (first, second)]
    if versions[0] != versions[1]:
        changes.append(f"eqt {' → '.join(versions)}")
    return [
        f"what differs: {', '.join(changes) or 'nothing'}",
        "runs are paired by their equal starts" if paired else "runs are not paired: other starts",
    ]


ROUNDED = 1e-12
"""Relative, and in the units of poses and velocities: starts of one draw differ by less where two
engines or two processors round them, and those of two draws by far more."""

MOST_CHANGES = 4
"""Maximum number of changed keys that a comparison of two results names."""


def chosen_labels(
    result: Result, controllers: Sequence[str], *, without_start: bool = False
) -> list[str]:
    """The labels of the laws of a result, in its order; all if none is named.

    Raises
    ------
    EqtError
        If there is no such controller, or no start to leave out.
    """
    require_list("controllers", controllers)
    wanted = [result.labels[result.position_of(name)] for name in controllers]
    concluded = conclusion_of(result)
    if without_start and not concluded.starts:
        raise result.error("is not the result of a tuning, so it has no starting gains")
    starts = concluded.starts if without_start else ()
    usual = concluded.compared(result)
    return [label for label in result.labels if label in (wanted or usual) and label not in starts]


def compare_sweep(
    result: ResultPath,
    metrics: Sequence[str],
    *,
    controllers: Sequence[str] = (),
    units: Sequence[str] = (),
    confidence: float = Resampling.confidence,
    resamples: int = Resampling.resamples,
    seed: int = Resampling.seed,
    share: float = 0.9,
) -> list[Map]:
    """Compare the laws at each point of a sweep, and find the points that each wins.

    Parameters
    ----------
    result
        The result folder, or the file in it.
    metrics
        Names of stored metrics; each gives a map.
    controllers
        Labels or titles of the controllers to compare; all if empty.
    units, confidence, resamples, seed
        As for `compare`.
    share
        A law is not ranked at a point where it settles in fewer than 1 − `share` of the runs and
        another law in `share` of them, or where more than 1 − `share` of its runs fail.

    Returns
    -------
    list of Map
        The comparison of the laws at each point, for each metric.

    Raises
    ------
    EqtError
        If the result is not a sweep, or does not have a metric.

    Examples
    --------
    >>> (map,) = eqt_cli.compare_sweep("results/sweep_gains", ["effort"])
    >>> map.labels
    ['eqt', 'gt']
    """
    from eqt_cli.analysis.maps import compare_map

    with open_result(path_from("result", result)) as opened:
        results = opened.in_units(units)
        if not results.is_sweep:
            raise results.error("is a single experiment; compare its controllers with `compare`")
        how = Resampling(confidence, resamples, seed)
        chosen = [results.labels.index(label) for label in chosen_labels(results, controllers)]
        return [compare_map(results, name, how, chosen, settling=share) for name in metrics]
