"""What a simulated difference is worth: predictions of flights, confronted with them."""

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.errors import OTHER_FOLDER, EqtError, InputError
from eqt_cli.base.files import new_file, read_record, refusals, write_record
from eqt_cli.base.option_types import plain_data
from eqt_cli.base.reporting import Block, TextTable, count_of, listed, reporter, significant, step
from eqt_cli.config.document import Document
from eqt_cli.extensions.flights import agreement, flying
from eqt_cli.extensions.flights.agreement import Agreement, Share, Verdict
from eqt_cli.extensions.flights.flying import Flight, Simulated, rms
from eqt_cli.extensions.logs.api import log_errors, measured_series, reading_once
from eqt_cli.extensions.logs.flight_list import ListedFlight, is_list, read_list
from eqt_cli.extensions.logs.many import digest_of, placed
from eqt_cli.extensions.logs.same_motion import motion_from, motion_of, twins

FITTED_ON = "fitted_on.json"
"""Beside a fitted configuration: the recordings that it was fitted on."""

WIDE = 200
"""Columns of a terminal for which `Validation.text` is laid out."""

SETTLED = 1 / 3
"""Last share of the window whose error counts as settled."""

MOSTLY = 0.5
"""Share of the difference of two squares from which its cause is named."""


@dataclass(frozen=True)
class Validation:
    """Predictions of flights, and what flights say of them.

    Attributes
    ----------
    quantity, unit
        What is compared.
    flown
        The flights as the model flies them.
    agreement
        The statistics.
    digest
        Of plant and laws of the model.
    speed
        The largest mean speed of the setpoints, m/s; NaN if it is no motion in space.
    notes
        Remarks on flights and model.
    """

    quantity: str
    unit: str
    flown: list[Simulated]
    agreement: Agreement
    digest: str
    speed: float
    notes: list[str]

    @property
    def headline(self) -> str:
        """The answer, in a sentence."""
        of, best = self.agreement, self.agreement.best
        ordered = f"simulation orders {percent(of.share)} of the pairs of {of.settings} settings"
        other = f"{best.name}{' of other flights' if best.name == agreement.SINGLE else ''}"
        choice = f" ({best.choice})" if best.choice else ""
        ends = {
            Verdict.CONFIRMED: "confirmed",
            Verdict.CONTRADICTED: "contradicted",
            Verdict.NOT_SHOWN: "not shown to be better",
        }
        share = f"{100 * best.share:.0f} %"
        return f"{ordered} as the flights do; {other}{choice} {share}: {ends[of.verdict]}"

    @property
    def text(self) -> str:
        """The answer with its tables, as `eqt validate` prints it."""
        from eqt_cli.cli.tables import table_text

        pieces = [self.headline, *(str(table_text(table, WIDE)) for table in tables(self))]
        return "\n\n".join([*pieces, *self.agreement.notes, *self.notes])

    @property
    def line(self) -> str:
        """The answer for other commands, in a line."""
        of = self.agreement
        facts = [count_of(of.settings, "setting"), count_of(of.laws, "law")]
        facts += [count_of(of.days, "day")] if of.days else []
        facts += [f"up to {self.speed:.2g} m/s"] if np.isfinite(self.speed) else []
        best = f"{of.best.name} {100 * of.best.share:.0f} %"
        signs = f"{percent(of.share)} of signs right"
        return f"flights: {of.verdict}: {signs}, {best}; {', '.join(facts)}"

    @property
    def document(self) -> dict[str, Any]:
        """All findings, for programs."""
        of = self.agreement
        record = {name: value for name, value in vars(of).items() if name not in ("notes",)}
        record |= {name: getattr(of, name)._asdict() for name in ("share", "level")}
        record |= {name: [x._asdict() for x in getattr(of, name)] for name in ("nulls", "variants")}
        flights = [
            one.row()._asdict() | {"window": one.flight.window, "late": one.late}
            for one in self.flown
        ]
        return {
            "answer": self.headline,
            "verdict": of.verdict,
            "line": self.line,
            "quantity": self.quantity,
            "unit": self.unit,
            "agreement": record,
            "flights": flights,
            "digest": self.digest,
            "speed": self.speed,
            "notes": [*of.notes, *self.notes],
        }


def percent(share: Share) -> str:
    """Return a share with its interval, in percent."""
    value, low, high = (f"{100 * x:.0f}" for x in share)
    return f"{value} % [{low}, {high}]"


# Reads the flights --------------------------------------------------------------------------------


@reading_once()
def flights_of(
    rows: Sequence[ListedFlight], metric: str | None, lap: float | None, how: Mapping[str, Any]
) -> tuple[list[Flight], list[str]]:
    """Return the flights of a list with their windows, and remarks.

    Raises
    ------
    EqtError
        If one cannot be read or stands twice, or flights are of two vehicles.
    """
    _one_vehicle(rows)
    flights, motions, notes = list[Flight](), {}, list[str]()
    digests = dict[str, Path]()
    with step("flights", len(rows)):
        for one in rows:
            with placed(one):
                which = f"{digest_of(one.file)} {one.begin} {one.end}"
                if (same := digests.setdefault(which, one.file)) is not one.file:
                    raise InputError(f"the same recording as {same}; a flight counts once")
                tracking = log_errors(one.file, delays=False, **{**how, **one.how})
                quantity = metric or next(iter(tracking.curves))
                flights.append(flying.flight_of(one, tracking, quantity, lap))
                motion = motion_of(tracking.actual)
            if motion is not None:
                motions[f"{one.file} {one.begin}".strip()] = motion
            reporter().advance(1)
    for twin in twins(motions):
        raise EqtError(f"{twin.name}: {twin.words} as {twin.first}; a flight counts once")
    if len({flight.quantity for flight in flights}) > 1:
        raise EqtError("metric: flights have different quantities; choose one by --metric")
    if (count := sum(not flight.lap for flight in flights)) and lap is None:
        which = "The" if count == len(flights) else f"{count} of the"
        notes.append(f"{which} flights repeat no lap, so that their whole time counts (--lap)")
    return flights, notes


def _one_vehicle(listed: Sequence[ListedFlight]) -> None:
    names = {one.factors.get("vehicle", "") for one in listed}
    if len(names) > 1:
        several = " and ".join(sorted(name or "none" for name in names))
        raise EqtError(
            f"vehicle: these are flights of {several}; a model is of one vehicle: make a list, and "
            "a model, for each"
        )


def refuse_fitted_on(model: Path, flights: Sequence[Flight]) -> None:
    """Raise an error if the model was fitted on one of the flights, or on the same motion."""
    file = (model if model.is_dir() else model.parent) / FITTED_ON
    if not file.is_file():
        return
    with refusals(file, "read"):
        record = read_record(file, "flights")
    try:
        every = (record or {})["flights"]
        recordings = {f"{x['file']}": (f"{x['digest']}", f"{x['motion']}") for x in every}
        before = {f"{name} ": motion_from(text) for name, (_, text) in recordings.items() if text}
    except (ValueError, KeyError, TypeError):
        raise EqtError(f"{file}: eqt did not write it; fit the model again") from None
    advice = "give other flights, or fit to others by --fit"
    digests = {digest: name for name, (digest, _) in recordings.items()}
    for flight in flights:
        if (name := digests.get(digest_of(flight.listed.file))) is not None:
            raise EqtError(f"{flight.listed.file}: the model was fitted on it ({name}); {advice}")
    for flight in flights:
        motion = motion_of(flight.tracking.actual)
        if motion is None:
            continue
        for twin in twins(before | {f"{flight.listed.file}": motion}):
            if twin.name == f"{flight.listed.file}":
                why = f"the model was fitted on it as {twin.first.strip()}: {twin.words}"
                raise EqtError(f"{flight.listed.file}: {why}; {advice}")


def note_fitted_on(folder: Path, measured: Path, mapping: Any) -> None:
    """Write beside a fitted configuration what tells its recordings again."""
    rows = read_list(measured) if is_list(measured) else [ListedFlight(measured)]
    record = []
    for one in rows:
        motion = None
        with suppress(EqtError):  # a recording of rates has no motion
            motion = motion_of(measured_series(one.file, one.mapping or mapping))
        words = motion.as_text() if motion else ""
        record.append({"file": one.file.name, "digest": digest_of(one.file), "motion": words})
    with refusals(folder / FITTED_ON, "written", OTHER_FOLDER):
        write_record(folder / FITTED_ON, {"flights": record})


VALIDATION = "validation.json"


def write(outcome: Validation, folder: Path) -> Path:
    """Write the statement for the key `validation`; replace only one that eqt wrote."""
    file = folder / VALIDATION
    with refusals(file, "written", OTHER_FOLDER):
        if file.exists() and read_record(file, "answer", "digest") is None:
            raise EqtError(f"{file}: eqt did not write it; {OTHER_FOLDER}")
        folder.mkdir(parents=True, exist_ok=True)
        write_record(file, json.loads(json.dumps(plain_data(outcome.document))))
    return file


# Confronts ----------------------------------------------------------------------------------------


def simulated(
    flights: Sequence[Flight], models: Mapping[str, Document]
) -> tuple[list[Simulated], list[str]]:
    """Fly all flights, each with its model by `key_of`; return them with remarks."""
    flown, plants = list[Simulated](), dict[str, Any]()
    with step("flights", len(flights)):
        for flight in flights:
            with placed(flight.listed):
                flown.append(flying.simulated(models[key_of(flight)], flight, plants))
            reporter().advance(1)
    every = set.intersection(*({*one.variants} for one in flown))
    odd = set.union(*({*one.variants} for one in flown)) - every
    remarks = [f"Runs of some flights fail with {listed(sorted(odd))}: left out."] if odd else []
    for k, one in enumerate(flown):
        variants = {name: curve for name, curve in one.variants.items() if name in every}
        flown[k] = replace(one, variants=variants)
    return flown, remarks


def confronted(
    flown: list[Simulated], models: Mapping[str, Document], least: float, notes: Sequence[str]
) -> Validation:
    """Compare predictions with flights."""
    of, first = agreement.agreement([one.row() for one in flown], least), flown[0].flight
    speeds = [one.flight.numbers.get("speed", np.nan) for one in flown]
    digest = digest_of_model(models[key_of(first)])
    unit = next(x.unit for x in first.tracking.sizes if x.quantity == first.quantity)
    remarks = [*notes, *_remarks(of)]
    return Validation(first.quantity, unit, flown, of, digest, float(max(speeds)), remarks)


SAME = 1e-4
"""Relative difference of predictions, of one model, that processors and compilers make."""


def predictions_in(flown: Sequence[Simulated], file: Path) -> bool:
    """Write the predictions if there is no file, and return False; else compare them with it.

    Raises
    ------
    EqtError
        If predictions differ from those in the file.
    """
    names = sorted({*flown[0].variants})
    rows = {key_of_row(one): [rms(one.curve[1])] for one in flown}
    for one in flown:
        rows[key_of_row(one)] += [rms(one.variants[name][1]) for name in names]
    with refusals(file, "read" if file.exists() else "written"):
        if not file.exists():
            stream = io.StringIO()
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(["flight", "law", "condition", "predicted", *names])
            writer.writerows([[*key, *(f"{x:.7g}" for x in row)] for key, row in rows.items()])
            file.parent.mkdir(parents=True, exist_ok=True)
            new_file(file, stream.getvalue().encode())
            return False
        lines = [*csv.reader(io.StringIO(file.read_text()))]
    with suppress(ValueError, IndexError):
        before = {tuple(line[:3]): float(line[3]) for line in lines[1:]}
        for key, row in rows.items():
            if abs(before.get(key, np.inf) - row[0]) > SAME * row[0]:
                got = f"{row[0]:.7g}, and {before.get(key, np.nan):.7g} in the file"
                raise EqtError(
                    f"{file}: another prediction of {key[0]}: {got}; the model, the flights or eqt "
                    "changed: write another file"
                )
        return True
    raise EqtError(f"{file}: expected a table that eqt validate --predictions wrote")


def key_of_row(one: Simulated) -> tuple[str, str, str]:
    """Return what names a flight in a table of predictions."""
    listed = one.flight.listed
    return " ".join([listed.file.name, listed.begin]).strip(), listed.law, listed.condition


def key_of(flight: Flight) -> str:
    """Return what tells flights of a list apart."""
    return f"{flight.listed.file} {flight.listed.begin} {flight.listed.end}"


def digest_of_model(document: Document) -> str:
    """Return the digest of plant and laws: all of a model but starts, references and times."""
    import hashlib

    names = ("group", "inertia", "model", "plant", "actuators", "control", "sensors", "estimator")
    data = {name: document.data.get(name) for name in names}
    data["laws"] = [_shape(entry) for entry in document.data.get("controllers") or []]
    text = json.dumps(data, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _shape(entry: Any) -> Any:
    """Return a law without its numbers and its label, which flights vary."""
    if isinstance(entry, dict):
        return {key: _shape(value) for key, value in entry.items() if key != "label"}
    if isinstance(entry, list):
        return "numbers"
    return "number" if isinstance(entry, int | float) else entry


def _remarks(of: Agreement) -> Iterator[str]:
    """Say what a verdict lacks."""
    if of.plant is not None and of.plant is not of.verdict and (wrong := of.best_variant):
        yield (
            f"The plant is not tested: with {wrong.name}, the model orders "
            f"{100 * wrong.share:.0f} % as the flights do."
        )
    apart = abs(np.log(of.level.value))
    if apart > np.log(1.25):
        yield f"Levels are wrong by a factor of {np.exp(apart):.2g}: read ratios, not metres."


# Tables -------------------------------------------------------------------------------------------


def tables(outcome: Validation) -> list[TextTable]:
    """Return what stands beside the answer, and where predictions and flights part."""
    return [_nulls(outcome), _groups(outcome)]


def _nulls(outcome: Validation) -> TextTable:
    of = outcome.agreement
    rows = [["simulation", percent(of.share)]]
    for null in [*of.nulls, *of.variants]:
        rows.append(
            [null.name, f"{100 * null.share:.0f} %" + (f" ({null.choice})" if null.choice else "")]
        )
    verdict = f"order: {of.verdict}"
    verdict += f"; plant: {of.plant}" if of.plant is not None else ""
    notes = [
        f"{verdict}. Confirmed: the lower end of the interval lies above the best rule (plant: and "
        "above the best wrong model); contradicted: the upper end lies below 50 %.",
        f"{of.pairs} pairs of settings in a condition, predicted at least {100 * of.least:g} % "
        "apart; rules are chosen on all other settings.",
    ]
    if np.isfinite(of.trusted):
        notes.append(
            f"Predicted differences above {100 * of.trusted:.0f} % had the right sign in "
            f"{100 * of.trusted_share:.0f} % of {of.trusted_pairs} pairs (found on other settings)."
        )
    else:
        notes.append("No predicted difference had the right sign in nine of ten pairs.")
    level, low, high = (significant(x, 3) for x in of.level)
    notes.append(
        f"Predicted over measured {outcome.quantity} error: {level} [{low}, {high}], scatter "
        f"×/÷{of.spread:.3g}; measured errors of settings: ×/÷{of.spread_flown:.3g}; rank "
        f"correlation {of.rank:.2f}."
    )
    title = f"Pairs of settings that flights order likewise, of {outcome.quantity} errors"
    return TextTable("nulls", title, ["rule", "right"], [Block("", rows)], notes)


def _groups(outcome: Validation) -> TextTable:
    groups = dict[tuple[str, str], list[Simulated]]()
    for one in outcome.flown:
        groups.setdefault((one.flight.law, one.flight.listed.condition), []).append(one)
    rows = []
    for (law, condition), some in sorted(groups.items()):
        measured = _mean([rms(one.flight.errors[1]) for one in some])
        predicted = _mean([rms(one.curve[1]) for one in some])
        settled = [_mean([_settled(curve(one)) for one in some]) for curve in (_flown, _simulated)]
        cells = [measured, predicted, predicted / measured, *settled]
        rows.append(
            [law or "-", condition or "-", f"{len(some)}"]
            + [significant(x, 3) for x in cells]
            + [_cause(some)]
        )
    unit = outcome.unit
    header = ["law", "condition", "flights", f"measured, {unit}", "predicted", "ratio"]
    header += ["settled", "predicted", "where they part"]
    notes = [
        "Geometric means of the rms errors of flights; settled: over the last third of the window."
    ]
    title = "Measured and predicted errors"
    return TextTable("groups", title, header, [Block("", rows)], notes, keys=2)


def _mean(sizes: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(sizes))))


def _flown(one: Simulated) -> Any:
    return one.flight.errors


def _simulated(one: Simulated) -> Any:
    return one.curve


def _settled(curve: Any) -> float:
    t, rows = curve
    return rms(rows[t >= t[-1] - SETTLED * (t[-1] - t[0])])


def _cause(some: Sequence[Simulated]) -> str:
    """Return where predictions and flights part: axis, transient or delay, and what moves them."""
    words = []
    squares = np.mean([_axes(one) for one in some], axis=0)
    whole = squares.sum()
    if len(squares) > 1 and whole:
        k = int(np.argmax(abs(squares)))
        if abs(squares[k]) > MOSTLY * abs(squares).sum():
            words.append("xyz"[k])
    early = np.mean([_early(one) for one in some])
    if early > MOSTLY:
        words.append("at first")
    late = float(np.mean([one.late for one in some]))
    if some[0].flight.quantity == "position" and abs(late) > 1e-3:
        words.append(f"flown {abs(late):.2g} s {'later' if late > 0 else 'earlier'}")
    ratio = np.mean([np.log(rms(one.flight.errors[1]) / rms(one.curve[1])) for one in some])
    moves = {
        name: np.mean([np.log(rms(one.variants[name][1]) / rms(one.curve[1])) for one in some])
        for name in some[0].variants
    }
    helpful = {name: x for name, x in moves.items() if x * ratio > 0 and abs(x) > 0.02}
    if helpful and abs(ratio) > 0.05:
        name = max(helpful, key=lambda name: abs(helpful[name]))
        words.append(f"{name} would give {100 * np.expm1(helpful[name]):+.0f} %")
    return ", ".join(words) or "-"


def _axes(one: Simulated) -> Any:
    """Return by how much the mean squares of the errors along the axes differ."""
    flown, simulated = one.flight.errors[1][:, 1:], one.curve[1][:, 1:]
    if not flown.shape[1]:
        return np.zeros(1)
    return np.nanmean(flown**2, axis=0) - np.nanmean(simulated**2, axis=0)


def _early(one: Simulated) -> float:
    """Return the share of the difference of the squares that the first third of the window has."""
    (t, flown), (s, simulated) = one.flight.errors, one.curve
    apart = flown[:, 0] ** 2 - np.interp(t, s, simulated[:, 0]) ** 2
    first = t < t[0] + SETTLED * (t[-1] - t[0])
    return float(abs(apart[first].sum()) / max(abs(apart.sum()), 1e-300)) if len(t) else 0.0
