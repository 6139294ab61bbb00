"""Compares flights of two settings: the ratio of their errors, how sure it is, what else differs.

The unit is a flight: its laps share wind, battery and settings, so that their spread says nothing
of the next flight. What multiplies an error differs from flight to flight, hence logarithms.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator, TypeAdapter, ValidationError

from eqt_cli.analysis import gate
from eqt_cli.analysis.intervals import FEWEST, Interval, Word, holm
from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import OTHER_FOLDER, EqtError
from eqt_cli.base.files import read_record, refusals, write_record
from eqt_cli.base.reporting import Block, TextTable, fixed, reporter, significant
from eqt_cli.base.version import __version__
from eqt_cli.extensions.flights import one_look
from eqt_cli.extensions.flights.judging import CONFIDENCE, Design
from eqt_cli.extensions.logs.flight_list import ListedFlight
from eqt_cli.extensions.logs.logs import QUANTITIES, Series, TrackingErrors, raw_logs
from eqt_cli.extensions.logs.many import digest_of, placed
from eqt_cli.extensions.logs.recording import GAP
from eqt_cli.extensions.logs.same_motion import motion_from, motion_of, twins

LEAST_SECONDS, LEAST_SHARE, SLACK = 10.0, 0.5, 0.05
"""Least time that is compared, s, and as a share of the time with setpoints; and the share of a lap
that may be missing at the end."""

WHOLE, SHORTEST = 0.9, 2.0
"""The same of flights that are compared almost as a whole: indoors, some take 6 s."""

ALIKE, MOST_SHOWN = (0.9, 1.1), 6
"""Ratios of times, speeds and winds that are not told; largest number of settings that are told."""

KEPT, MOST_KEPT = "compared.json", 400
"""File of the output folder with what was measured, and of how many flights: with 1,000 parameters
each, 14 MB."""

SIZES: dict[str, Callable[[Array], Any]] = {"median": np.median, "largest": np.max}
SIZES["rms"] = lambda errors: np.sqrt(np.mean(errors**2))

Errors = Mapping[str, Sequence[Array]]
Tracked = Callable[[ListedFlight], TrackingErrors]
"""The errors of both sides by the quantity, and a function that measures those of a flight."""

OWN = re.compile(
    r"CAL_|TC_|COM_(FLIGHT_UUID|AUTOS_PAR)|LND_FLIGHT_T_|EKF2_MAG(BIAS|_DECL)|STAT_|COMPASS_|INS_|"
    r"BARO\d_GND|.*_ID\d?$"
)
"""Parameters that an autopilot writes itself, or that tell vehicles apart."""


# The numbers of a flight --------------------------------------------------------------------------


class Flown(NamedTuple):
    """The errors of a flight, or of a lap.

    Attributes
    ----------
    side, file, digest
        ``A``, or ``B``, against which it is compared; the file and its SHA-256.
    laps
        Number of laps; the errors are their geometric means.
    seconds, speed, wind
        Time that is compared, s, mean speed of the setpoints and mean wind, m/s; NaN if not logged.
    errors
        By the quantity, in its unit.
    settings
        Parameters, release and hardware at the begin.
    """

    side: str
    file: str
    digest: str
    laps: int
    seconds: float
    speed: float
    wind: float
    errors: dict[str, float]
    settings: dict[str, str]

    @property
    def record(self) -> dict[str, Any]:
        """A row of numbers, for programs."""
        return dict(zip(self._fields, self[:-2], strict=False)) | self.errors


def seconds_of(times: Array) -> float:
    """Return the time between rows, without gaps, s."""
    steps = np.diff(times)
    return float(steps[steps <= GAP * np.median(steps)].sum()) if len(steps) else 0.0


def settings_of(tracking: TrackingErrors, begin: float, end: float) -> tuple[dict[str, str], Any]:
    """Return the settings at the begin, and how they change until the end, in words."""
    settings, changes = dict[str, str](), dict[str, str]()
    topics = tracking.flight.topics if tracking.flight else []
    for t, name, value in (row for topic in topics for row in topic.settings if row[0] < end):
        text = f"{value:.7g}" if isinstance(value, float) else f"{value}"
        if t <= begin or name not in settings:
            settings[name] = text
        elif settings[name] != text and not OWN.match(name):
            changes.setdefault(name, f"{name} {settings[name]} → {text} at {t:.4g} s")
    return settings, [*changes.values()]


Lap = tuple[int, float, float, float, dict[str, float], dict[str, str]]
"""`Flown` behind its digest, of a lap or of a whole flight."""


def flown(file: str, tracking: TrackingErrors, of: str, cuts: Array) -> Lap:
    """Return the numbers of a flight, as in `Flown`, over laps between times."""
    errors, (begin, end) = dict[str, float](), cuts[[0, -1]]
    for quantity, (t, rows) in tracking.curves.items():
        x = abs(rows[:, 0])
        laps = (x[(a <= t) & (t < b) & np.isfinite(x)] for a, b in pairwise(cuts))
        sizes = [SIZES[of](lap) for lap in laps if len(lap)]
        if 0 in sizes:
            raise EqtError(f"{file}: the {of} {quantity} error is 0, which has no ratio")
        errors |= {quantity: float(np.exp(np.mean(np.log(sizes))))} if sizes else {}

    def numbers(series: Series) -> Array:
        return series.numbers[(begin <= series.times) & (series.times < end)]

    t = next(iter(tracking.curves.values()))[0]
    seconds = seconds_of(t[(begin <= t) & (t < end)])
    goals = [numbers(goal) for q, goal in tracking.goals.items() if q == "position"]
    speed = [np.nansum(norm(np.diff(x, axis=0))) / (seconds or math.nan) for x in goals]
    winds = tracking.flight.series("wind") if tracking.flight else ()
    wind = [norm(numbers(series)).mean() for series in winds]
    means = [float(x[0]) if x else math.nan for x in (speed, wind)]
    settings = settings_of(tracking, begin, end)[0]
    return len(cuts) - 1, seconds, means[0], means[1], errors, settings


def _readable(motion: str) -> str:
    if motion:
        motion_from(motion)  # raises ValueError
    return motion


class Evaluated(NamedTuple):
    """What is measured of a file once.

    Attributes
    ----------
    topics
        The topics that are compared, by the quantity.
    rows
        For each lap, or for the whole flight, `Flown` behind its digest.
    shift
        The delay that explains most of the errors, s; None if none is significant.
    motion
        The motion, as `Motion.as_text` writes it; empty if nothing moves.
    """

    topics: dict[str, str]
    rows: list[Lap]
    shift: float | None
    motion: Annotated[str, AfterValidator(_readable)] = ""


@contextmanager
def kept_in(folder: Path | None, how: Mapping[str, Any]) -> Iterator[dict[str, Evaluated]]:
    """Give what was measured of flights, by digest, and keep what is added, even after an error.

    Parameters
    ----------
    folder
        The output folder; None keeps nothing.
    how
        All that the numbers follow from, besides the flights; of files, their content counts.
    """
    if folder is None:
        yield {}
        return
    file, measured = folder / KEPT, dict[str, Evaluated]()
    which = {"eqt": __version__} | {name: content_of_option(value) for name, value in how.items()}
    if file.exists():
        with refusals(file, "read", OTHER_FOLDER):
            if (record := read_record(file, "how", "flights")) is None:
                raise ValueError("eqt did not write it")
        if record["how"] == which:
            with suppress(ValidationError):  # of another shape: evaluated again
                measured = TypeAdapter(dict[str, Evaluated]).validate_python(record["flights"])
    before = len(measured)
    try:
        yield measured
    finally:
        if len(measured) > before:
            with refusals(file, "written", OTHER_FOLDER):
                folder.mkdir(parents=True, exist_ok=True)
                latest = dict([*measured.items()][-MOST_KEPT:])
                write_record(file, {"how": which, "flights": latest})


def content_of_option(value: Any) -> str:
    """Return what stands for an option: of a file, its digest."""
    is_file = isinstance(value, str | Path) and value and Path(value).exists()
    return digest_of(Path(value)) if is_file else repr(value)


def evaluated(
    flight: ListedFlight, tracked: Tracked, of: str, period: float, within: str
) -> Evaluated:
    """Return the errors of a flight, or of the laps `within` one; refuse what is no unit."""
    file = flight.file
    with placed(flight):
        tracking = tracked(flight)
    t = next(iter(tracking.curves.values()))[0]
    begin, end = t[0], np.nextafter(t[-1], np.inf)
    seconds, whole = map(seconds_of, (t, next(iter(tracking.goals.values())).times))
    shortest = SHORTEST if seconds >= WHOLE * whole else LEAST_SECONDS
    if seconds < max(shortest, LEAST_SHARE * whole):
        least = f"{LEAST_SECONDS:g} s or more, and half of {whole:.4g} s with setpoints"
        raise EqtError(f"{file}: only {seconds:.4g} s are compared; expected {least}")
    if (changes := settings_of(tracking, begin, end)[1]) and not within:
        advice = "take a part by --begin and --end, or laps in turns by --within"
        raise EqtError(f"{file}: changed in flight: {', '.join(changes)}; {advice}")
    lap = period or end - begin
    cuts = begin + lap * np.arange(1 + (len(within) or int((end - begin) / lap + SLACK)))
    if len(cuts) < 2 or cuts[-1] > end + SLACK * lap:
        raise EqtError(f"{file}: {end - begin:.4g} s are too few for laps of {period:g} s")
    laps = [cuts[k : k + 2] for k in range(len(within))] or [cuts]
    rows = [flown(f"{file}", tracking, of, lap) for lap in laps]
    for *_, settings in rows:
        settings |= flight.settings
    shift = next((size.delay for size in tracking.sizes if math.isfinite(size.delay)), None)
    motion = motion_of(tracking.actual)
    words = motion.as_text() if motion else ""
    # Of a table of Betaflight, the topic is the table
    has_topics = tracking.flight is not None and tracking.flight.format != "blackbox"
    return Evaluated(dict(tracking.topics) if has_topics else {}, rows, shift, words)


def read_flights(
    flights: Sequence[tuple[str, ListedFlight]],
    tracked: Tracked,
    of: str,
    period: float,
    within: str,
    measured: dict[str, Evaluated],
    shifts: dict[Path, float],
    duplicates: bool = False,
) -> Iterator[Flown]:
    """Yield the flights of both sides, or the laps `within` one; refuse those that are no unit.

    A recording that stands twice is refused before anything is evaluated, and one of the same
    motion before anything is returned, unless `duplicates` count. Of recordings that are
    `measured`, by digest, nothing is evaluated; the others are added. `shifts` gets that of each
    file.
    """
    topics = dict[str, tuple[str, Path]]()
    digests = _digests([one for _, one in flights], duplicates)
    for (_, one), digest in zip(flights, digests, strict=True):
        if digest not in measured:
            measured[digest] = evaluated(one, tracked, of, period, within)
        reporter().advance(1)
    if not duplicates:
        texts = [
            (one.file, measured[k].motion) for (_, one), k in zip(flights, digests, strict=True)
        ]
        for twin in twins({f"{file}": motion_from(text) for file, text in texts if text}):
            raise EqtError(f"{twin.name}: {twin.words} as {twin.first}; {ONCE}")
    for (side, one), digest in zip(flights, digests, strict=True):
        flight, file = measured[digest], one.file
        if flight.shift is not None:
            shifts[file] = flight.shift
        for quantity, pair in flight.topics.items():
            if (other := topics.setdefault(quantity, (pair, file)))[0] != pair:
                advice = "choose the topics of all by --topic and --setpoint"
                raise EqtError(f"{file}: compares {pair}, but {other[1]} {other[0]}; {advice}")
        for k, row in enumerate(flight.rows):
            name = (within[k], f"{file} lap {k + 1}") if within else (side, f"{file}")
            facts: Any = *name, digest, *row
            yield Flown(*facts)


ONCE = "a flight counts once: leave one out, or include both by --duplicates"


def _digests(flights: Sequence[ListedFlight], duplicates: bool) -> list[str]:
    """Return what tells flights apart; refuse a recording that stands twice."""
    first, digests = dict[str, Path](), list[str]()
    for one in flights:
        parts = {name: content_of_option(value) for name, value in one.how.items()}
        whole = digest_of(one.file)
        if beside := [digest_of(raw) for raw in raw_logs(one.file)]:
            parts["raw logs"] = f"{beside}"  # their settings are compared
        digests.append(sha256(f"{whole} {parts}".encode()).hexdigest() if parts else whole)
        same = first.setdefault(f"{whole} {one.begin} {one.end}", one.file)
        if same is not one.file and not duplicates:
            raise EqtError(f"{one.file}: the same recording as {same}; {ONCE}")
    return digests


MOST_APART = 0.25
"""Largest difference of the shifts in time that fit flights best to one desired motion, s."""


def remarks_on_shifts(shifts: Mapping[Path, float]) -> Iterator[str]:
    """Say by how much flights are late of one desired motion; refuse those that start otherwise.

    Raises
    ------
    EqtError
        If the shifts of two flights are further apart than `MOST_APART`: then it is not the motion
        that one of them was told to follow.
    """
    if not shifts:
        return
    first, last = min(shifts, key=lambda file: shifts[file]), max(shifts, key=shifts.__getitem__)
    ends = f"{shifts[first]:.3g} s ({first}) to {shifts[last]:.3g} s ({last})"
    if shifts[last] - shifts[first] > MOST_APART:
        advice = "give each flight its own setpoints: columns of its table, or its log"
        raise EqtError(
            f"second: the shift in time that fits a flight best is from {ends}, which is more than "
            f"{MOST_APART:g} s apart: one desired motion does not fit them all; {advice}"
        )
    yield f"the desired motion fits flights best with a shift of {ends}"


# Two sides ----------------------------------------------------------------------------------------


class FlightRatio(NamedTuple):
    """The ratio of the errors of A and B.

    Attributes
    ----------
    metric, unit, first, second
        The quantity with its unit, and the geometric means of A and of B.
    ratio, low, high
        Their ratio with its 95 % interval; NaN for too few flights.
    p
        Of the test of the `Design`, adjusted after Holm (1979) for all quantities.
    word, decided
        The word for A by the interval, and whether it stands: *better* and *worse* need the test.
    needed
        Flights of a side, or pairs, whose interval excludes 1 with probability 0.8, if the ratio is
        as measured.
    worth
        Flights of a side, or pairs, that would say as much without the model; None without one.
    """

    metric: str
    unit: str
    first: float
    second: float
    ratio: float
    low: float
    high: float
    p: float
    word: Word
    decided: bool
    needed: int | None
    worth: float | None = None

    def __str__(self) -> str:
        """``−19 % [−30, −6], better``."""
        digits = 0 if self.high - self.low > 0.05 else 1
        value, *ends = (fixed(100 * x - 100, digits, signed=True) for x in self[4:7])
        change = f"{value} % [{', '.join(ends)}]".removesuffix(" [-, -]").replace("-", "−")
        word = f", {self.word if self.decided else Word.UNDECIDED}"
        more = f"; {self.needed} of each would decide" if self.needed and not self.decided else ""
        return change if math.isnan(self.low) else change + word + more


def ratios(errors: Errors, design: Design, negligible: float) -> Iterator[FlightRatio]:
    """Yield the ratio of the errors of A and B for each quantity."""
    rows = [(q, np.log(x), np.log(y)) for q, (x, y) in errors.items()]
    tests = [design.p(x, y) for _, x, y in rows]
    for (q, x, y), p in zip(rows, holm(np.array(tests)).tolist(), strict=True):
        ends, spread = design.ends(x, y, CONFIDENCE)
        word = Word.BETTER if ends.high < 0 else Word.WORSE if ends.low > 0 else Word.UNDECIDED
        is_alike = max(-math.expm1(ends.low), math.expm1(ends.high)) <= negligible
        decided = is_alike or (word is not Word.UNDECIDED and p <= 1 - CONFIDENCE)
        numbers = [_ratio(number) for number in (x.mean(), y.mean(), *ends)]
        if math.isinf(ends.low) or math.isinf(ends.high):
            numbers[-2:] = [math.nan, math.nan]
        word = Word.ALIKE if is_alike else word
        needed = design.needed(ends.value / spread, CONFIDENCE)
        if needed is not None:
            more = 0 if decided else min(len(x), len(y)) + 1
            needed = max(needed, design.least(len(errors)), more)
        worth = design.worth(x, y, CONFIDENCE)
        row: Any = q, QUANTITIES[q][0], *numbers, p, word, decided, needed, worth
        yield FlightRatio(*row)


def _ratio(logarithm: float) -> float:
    """Return the ratio; infinite for ends that nothing bounds."""
    return math.inf if logarithm == math.inf else math.exp(logarithm)


def finding(rule: gate.Rule, errors: Errors, design: Design) -> gate.Finding:
    """Return what the one-sided bounds of a change say of a rule."""
    if rule.metric not in errors:
        raise EqtError(f"fail_on: '{rule}': expected one of {', '.join(errors)}")
    x, y = errors[rule.metric]
    factor, is_relative = rule.factor(QUANTITIES[rule.metric][0]), rule.unit == "%"
    margin = rule.margin / factor
    if is_relative:
        x, y, margin = np.log(x), np.log(y), math.log1p(margin)
    change, spread = design.ends(x, y, gate.TWO_SIDED, logs=is_relative)
    ends = (factor * (_ratio(end) - 1 if is_relative else float(end)) for end in change)
    facts: Any = {"noun": design.noun, "names": {"metric": rule.metric}}
    n, needed = min(len(x), len(y)), design.needed(margin / spread, gate.TWO_SIDED)
    return gate.Finding(rule, rule.metric, Interval(*ends), n, needed, **facts)


def _counted(values: Counter[str]) -> str:
    return ", ".join(f"{value} ({k})" if len(values) > 1 else value for value, k in values.items())


def premises(sides: Sequence[list[Flown]], every: bool) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the settings that are not the same in all flights, and what differs in words."""
    differing, lines = list[dict[str, Any]](), list[str]()
    flights = [x for side in sides for x in side]
    every_name = dict.fromkeys(name for x in flights for name in x.settings)
    names = [name for name in every_name if every or not OWN.match(name)]
    shared = [name for name in names if all(name in x.settings for x in flights)]
    for name in shared:
        a, b = (Counter(x.settings[name] for x in side) for side in sides)
        if len(a | b) > 1:
            differing.append({"name": name, "A": a, "B": b})
            mixed = [side for side, count in (("A", a), ("B", b)) if len(count) > 1]
            where = (
                f"the flights of {' and '.join(mixed)} do not have one setting: " if mixed else ""
            )
            in_all = " in all" if not mixed else ""
            lines.append(f"{where}{name} {_counted(b)} → {_counted(a)}{in_all}")
    more, alone = len(lines) - MOST_SHOWN, len(names) - len(shared)
    lines[MOST_SHOWN:] = [f"and {more} more differences (--json)"] if more > 0 else []
    if alone > 0:
        lines += [f"{alone} settings are not in all files"]
    if shared and not lines:
        lines += ["all flights have the same settings"]
    for name, words in ("seconds", "as long"), ("speed", "as fast"), ("wind", "as windy"):
        x, y = (float(np.mean([getattr(x, name) for x in side])) for side in sides)
        if y > 0 and (x / y < ALIKE[0] or x / y > ALIKE[1]):
            lines.append(f"the flights of A are {x / y:.2g} times {words} as those of B")
    return differing, lines


def remarks(n: int, m: int, design: Design, tests: int) -> Iterator[str]:
    """Yield what limits the words, and what the numbers are."""
    least = design.least(tests)
    fewer = ", or fewer quantities (--metric)" if tests > 1 else ""
    if n == m == 1:
        yield "this compares two flights, not two settings"
    elif design.blocks is not None:
        if min(n, m) < least:
            count = f"{min(n, m)} pairs" if design.noun == "pair" else f"{n} and {m} flights"
            yield f"{count}: {least} are the least for better or worse at any look{fewer}"
    elif design.paired and n < least:
        none = "no interval below 5; " if n < FEWEST else ""
        yield f"{n} pairs: {none}{least} are the least for better or worse{fewer}"
    elif min(n, m) < FEWEST:
        advice = "pairs flown in the same hour need far fewer"
        yield f"{n} and {m} flights: no interval and no words below {FEWEST} each; {advice}"
    if design.blocks is None:
        yield ONE_LOOK
    yield f"A, B: geometric means; {design.words}"


ONE_LOOK = (
    "p and intervals hold for a number of flights that was planned before; to look after each "
    "flight, use --sequential"
)


def remarks_on_a_model(rows: Sequence[FlightRatio], size: int, design: Design) -> Iterator[str]:
    """Say how many flights are worth as many as those with the model."""
    noun = "pairs" if design.paired else "flights of each"
    for one, worth in ((row, row.worth) for row in rows):
        if worth is not None:
            cost = "" if worth > size else ": it costs more than it gives"
            yield f"{one.metric}: with the model, {size} {noun} are worth {worth:.0f}{cost}"


def remarks_on_flights(sides: Sequence[list[Flown]], metric: str) -> Iterator[str]:
    """Yield what the flights of each side say of the certainty: how far halves of them differ."""
    for side in sides:
        x = np.log([flight.errors[metric] for flight in side])
        if len(x) >= 2 * FEWEST:
            count, apart = one_look.null_splits(x, CONFIDENCE)
            half = len(x) // 2
            ends, _ = one_look.difference(x[-half:], x[:half], False, CONFIDENCE)
            change, low, high = (f"{100 * math.expm1(end):+.0f}".replace("-", "−") for end in ends)
            yield (
                f"{len(x)} flights of {side[0].side}: {count} of {one_look.SPLITS} splits into "
                f"halves are called different, 95 % differ by at most "
                f"{100 * math.expm1(apart):.2g} %; the "
                f"last half against the first: {change} % [{low}, {high}]"
            )


def remarks_on_drift(
    sides: Sequence[list[Flown]], metric: str, places: Sequence[Sequence[int]], *, is_order: bool
) -> Iterator[str]:
    """Say that errors change from flight to flight, with one side flown before the other.

    Where no list gives the order (`is_order`), files may have been flown in turns.
    """
    logs = [np.log([flight.errors[metric] for flight in side]) for side in sides]
    slope, p = one_look.drift(logs, places)
    bias = slope * float(np.mean(places[0]) - np.mean(places[1]))
    if p <= LEAST_P_OF_A_DRIFT and abs(bias) > WORTH_TELLING:
        first = "B" if np.mean(places[0]) > np.mean(places[1]) else "A"
        when = f"with {first} flown first" if is_order else f"if all of {first} was flown first"
        change, alone = (f"{100 * math.expm1(x):+.1f}".replace("-", "−") for x in (slope, bias))
        yield (
            f"drift: {metric} errors change by {change} % from flight to flight on both sides (p "
            f"{p:.2g}); {when}, that alone makes A {alone} % against B: fly in turns, or in pairs"
        )


LEAST_P_OF_A_DRIFT, WORTH_TELLING = 0.01, 0.02


class FlightComparison(NamedTuple):
    """Flights of a setting A against those of a setting B.

    Attributes
    ----------
    flights
        The flights; of pairs, those of a pair one after the other.
    pairs
        The ratio of the errors of both sides, for each quantity.
    parameters
        Settings that are not the same in all flights, with the number of flights by their values.
    premises
        What differs besides the errors, in words.
    notes
        What limits the words, and what the numbers are.
    findings
        What each rule of `fail_on` says.
    paired
        Whether flights are compared in pairs.
    """

    flights: list[Flown]
    pairs: list[FlightRatio]
    parameters: list[dict[str, Any]]
    premises: list[str]
    notes: list[str]
    findings: list[gate.Finding]
    paired: bool

    @property
    def document(self) -> dict[str, Any]:
        """The numbers, for programs."""
        rows = {"flights": [x.record for x in self.flights]}
        rows["pairs"] = [x._asdict() for x in self.pairs]
        return {name: x for name, x in self._asdict().items() if name != "findings"} | rows

    def tables(self) -> Iterator[TextTable]:
        """Yield the ratios, and the numbers of each flight."""
        header = ["error", "unit", "A", "B", "A against B", "p"]
        rows = [
            [*x[:2], *map(significant, x[2:4]), f"{x}", significant(x.p, 2)] for x in self.pairs
        ]
        yield TextTable("ratios", "", header, [Block("", rows)], self.notes, keys=2)
        header = ["side", "file", "laps", "seconds", "speed", "wind", *(x[0] for x in self.pairs)]
        cells = [[flight.record[name] for name in header] for flight in self.flights]
        rows = [[significant(x, 3) if type(x) is float else f"{x}" for x in row] for row in cells]
        yield TextTable("flights", "", header, [Block("", rows)], keys=2)


def compared(
    flights: list[Flown],
    design: Design,
    metrics: Sequence[str],
    negligible: float,
    every: bool,
    rules: Sequence[gate.Rule],
    places: Sequence[Sequence[int]] = (),
) -> FlightComparison:
    """Compare the flights of both sides by the quantities that all have.

    Parameters
    ----------
    places
        When the flights of both sides were flown, as far as is known; empty: B first, then A.

    Raises
    ------
    EqtError
        If there is none, or a rule does not fit them.
    """
    every_side = [[x for x in flights if x.side == side] for side in "AB"]
    lacking = {q: [x.file for x in flights if q not in x.errors] for q in metrics or QUANTITIES}
    shared = [q for q, some in lacking.items() if not some]
    most = len(flights) + bool(metrics)  # what nobody has and nobody asked for is not told
    notes = [f"{q}: left out, as {x[0]} has none" for q, x in lacking.items() if 0 < len(x) < most]
    if not shared:
        raise EqtError(f"no quantity that all flights have; {'; '.join(notes)}")
    sides = [*design.used(*every_side)]
    errors = {q: [np.array([x.errors[q] for x in side]) for side in sides] for q in shared}
    notes += design.waiting(*map(len, every_side))
    notes += remarks(len(sides[0]), len(sides[1]), design, len(shared))
    pairs = [*ratios(errors, design, negligible)]
    notes[-1:-1] = remarks_on_a_model(pairs, min(map(len, sides)), design)
    findings = [finding(rule, errors, design) for rule in rules if rule.margin < math.inf]
    for rule in (rule for rule in rules if rule.margin == math.inf):
        if rule.metric == "failed" or min(map(len, sides)) < FEWEST:
            needs = f"worse needs {FEWEST} flights of each side, and failed is of runs"
            raise EqtError(f"fail_on: {needs}; try 'position worse by 10 %'")
        worse = (x for x in pairs if x.decided and x.word is Word.WORSE)
        findings += [gate.Finding(rule, x.metric, why=f"{x}") for x in worse]
    differing, lines = premises(sides, every)
    if not design.paired:
        where = places or [
            range(len(sides[1]), len(sides[0]) + len(sides[1])),
            range(len(sides[1])),
        ]
        used = [place[: len(side)] for place, side in zip(where, sides, strict=True)]
        lines += remarks_on_drift(sides, shared[0], used, is_order=bool(places))
        notes[-1:-1] = remarks_on_flights(sides, shared[0])
    return FlightComparison(flights, pairs, differing, lines, notes, findings, design.paired)
