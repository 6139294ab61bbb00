"""Confronts predictions of a model with flights."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from eqt_cli.api.loading import Configuration, document_from, path_from
from eqt_cli.base.errors import EqtError
from eqt_cli.config.document import Document
from eqt_cli.config.schema import without_search
from eqt_cli.extensions.flights import agreement, flying, validation
from eqt_cli.extensions.flights.api import fit
from eqt_cli.extensions.flights.flying import Flight
from eqt_cli.extensions.flights.validation import Validation
from eqt_cli.extensions.logs.api import MappingSource, literal
from eqt_cli.extensions.logs.flight_list import is_list, read_list, write_list
from eqt_cli.extensions.logs.many import placed


def validate(
    flights: str | os.PathLike[str],
    model: Configuration | Document,
    *,
    metric: str | None = None,
    lap: float | None = None,
    least: float = agreement.LEAST,
    over: Sequence[str] = (),
    hold_out: str = "setting",
    mapping: MappingSource = None,
    predictions: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    trust_plugins: bool = False,
) -> Validation | None:
    """Fly each flight's law along its own setpoints with a model, and compare with the flights.

    Parameters
    ----------
    flights
        A list of flights. Columns that are keys of the model, such as ``gains.kp``, are set for
        each flight; ``day`` and ``condition`` say what flights share.
    model
        A configuration as for `load_experiment`. A file that its reference reads is replaced by
        the setpoints of each flight, its start by that of the flight.
    metric
        What is compared, such as ``position``. Default: the first quantity that flights have.
    lap
        Time of a lap, s, which is left out at the begin. Default: that after which setpoints
        repeat.
    least
        The least predicted difference of two settings that are compared, as a share.
    over, hold_out
        Keys as for `fit`: the model of each flight is fitted to the flights of other settings, or
        laws, conditions or days. Default: the model as it is.
    mapping
        As for `check_log`, of flights whose row names none.
    predictions
        A table of predictions. If it is not there, it is written, nothing is compared, and None is
        returned: write it down before you look. If it is there, the predictions must equal it.
    out
        Folder for ``validation.json``, which the key ``validation`` of a configuration names.
    trust_plugins
        Whether to execute plugin sources that are stored in a result.

    Returns
    -------
    Validation
        How far flights agree with the simulation, beside rules that need none.

    Raises
    ------
    EqtError
        If the flights cannot be compared, a law is not in the model, a run fails, or the model
        was fitted on these flights.

    Examples
    --------
    Six flights of a body that turns back from 0.05 rad, whose damping differs:

    >>> import numpy as np
    >>> t, rows = np.linspace(0, 10, 101), [("file", "law", "gains.k_Omega")]
    >>> for k, d in enumerate((0.4, 0.6, 0.8, 1.0, 1.2, 1.4)):
    ...     w = np.sqrt(1 - d**2 / 4)
    ...     angle = 0.05 * np.exp(-d * t / 2) * (np.cos(w * t) + d / 2 / w * np.sin(w * t))
    ...     flown = np.c_[t, 0 * t, 0 * t, np.sin(angle / 2), np.cos(angle / 2)]
    ...     flown = np.c_[flown, 0 * t, 0 * t, 0 * t, 0 * t + 1]
    ...     head = "t,qx,qy,qz,qw,qx_ref,qy_ref,qz_ref,qw_ref"
    ...     np.savetxt(f"{k}.csv", flown, delimiter=",", header=head, comments="")
    ...     rows.append((f"{k}.csv", "lee", d))
    >>> np.savetxt("flights.csv", rows, "%s", ",")
    >>> model = {
    ...     "group": "SO3",
    ...     "inertia": [1, 1, 1],
    ...     "reference": {"kind": "waypoints", "file": "setpoints.csv"},
    ...     "controllers": [{"kind": "lee2010", "label": "lee"}],
    ...     "gains": {"k_R": 1, "k_Omega": 1},
    ... }
    >>> eqt_cli.validate("flights.csv", model).agreement.share.value
    1.0
    """
    path = path_from("flights", flights)
    if not is_list(path):
        raise EqtError(
            f"{path}: expected a list of flights; eqt log check FOLDER --out flights.csv writes it"
        )
    literal(HELD_OUT, "hold_out", hold_out)
    listed = read_list(path)
    document = (
        model
        if isinstance(model, Document)
        else document_from(model, {}, trust_plugins=trust_plugins)
    )
    document = replace(document, data=without_search(document.data))
    how = {"mapping": mapping} if mapping is not None else {}
    for one in listed:
        with placed(one):
            flying.law_of(document, one)
    read, notes = validation.flights_of(listed, metric, lap, how)
    validation.refuse_fitted_on(Path(document.path), read)
    models = dict.fromkeys(map(validation.key_of, read), document)
    if over:
        models = _fitted_to_others(document, read, over, hold_out, mapping)
    flown, failed = validation.simulated(read, models)
    if predictions is not None and not validation.predictions_in(flown, Path(predictions)):
        return None
    outcome = validation.confronted(flown, models, least, [*notes, *failed])
    if out is not None:
        validation.write(outcome, Path(out))
    return outcome


HELD_OUT = Literal["setting", "law", "condition", "day"]


def _fitted_to_others(
    document: Document,
    flights: Sequence[Flight],
    keys: Sequence[str],
    hold_out: str,
    mapping: MappingSource,
) -> dict[str, Document]:
    """Return the model of each flight, fitted to the flights of other settings, laws, ….

    Raises
    ------
    EqtError
        If there is only one setting, law, …, so that no other flights are left.
    """

    def which(flight: Flight) -> str:
        groups = {
            "setting": flight.setting,
            "law": flight.law,
            "condition": flight.listed.condition,
        }
        return (groups | {"day": flight.listed.factors.get("day", "")})[hold_out]

    names = [*dict.fromkeys(map(which, flights))]
    if len(names) < 2:
        raise EqtError(f"hold_out: all flights have one {hold_out}; nothing is left to fit to")
    models, by_name = dict[str, Document](), dict[str, Document]()
    with flying.folder_of_flights() as folder:
        for name in names:
            others = [flight.listed for flight in flights if which(flight) != name]
            file = folder / f"others{len(by_name)}.csv"
            write_list([replace(one, factors={}) for one in others], file)
            chosen = fit(document, file, keys, mapping, out=folder / f"fit{len(by_name)}")
            by_name[name] = chosen.document
    for flight in flights:
        models[validation.key_of(flight)] = by_name[which(flight)]
    return models
