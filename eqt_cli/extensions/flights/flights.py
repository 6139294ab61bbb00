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
from eqt_cli.analysis.intervals import FEWEST, Interval, Word, holm, runs_to_decide
from eqt_cli.api.loading import path_from
from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import OTHER_FOLDER, EqtError
from eqt_cli.base.files import read_record, refusals, write_record
from eqt_cli.base.reporting import Block, TextTable, fixed, reporter, significant
from eqt_cli.base.version import __version__
from eqt_cli.extensions.logs.flight_list import ListedFlight, is_list, read_list, recordings_in
from eqt_cli.extensions.logs.logs import QUANTITIES, Series, TrackingErrors, raw_logs
from eqt_cli.extensions.logs.many import digest_of, placed
from eqt_cli.extensions.logs.recording import GAP
from eqt_cli.extensions.logs.same_motion import motion_from, motion_of, twins

CONFIDENCE = 0.95
"""Of intervals and words."""

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

RESAMPLES = 9_999
"""Largest number of permutations that are all tried; else so many are drawn."""

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


# Statistics ---------------------------------------------------------------------------------------


def difference(x: Array, y: Array, paired: bool, confidence: float) -> tuple[Interval, Any]:
    """Return the difference of two means, with Student's interval, of Welch (1947) without pairs.

    Of logarithms, it is the logarithm of the ratio of geometric means.

    Parameters
    ----------
    x, y : (..., n), (..., m)
        Numbers of both sides.
    paired
        Whether number k of both belong together.

    Returns
    -------
    Interval, float
        Its ends are NaN for fewer than `FEWEST` numbers. The standard deviation of pairs, or of
        the difference of a number of each side; infinite if it is unknown or 0.
    """
    from scipy.special import stdtrit  # slow to import

    parts, value = [x - y] if paired else [x, y], x.mean(axis=-1) - y.mean(axis=-1)
    if min(x.shape[-1], y.shape[-1]) < FEWEST:
        return Interval(value, math.nan, math.nan), math.inf
    variances = [part.var(axis=-1, ddof=1) for part in parts]
    squares = [v / part.shape[-1] for v, part in zip(variances, parts, strict=True)]
    freedoms = [s**2 / (part.shape[-1] - 1) for s, part in zip(squares, parts, strict=True)]
    with np.errstate(invalid="ignore"):  # where all numbers of a side are equal
        t = stdtrit(sum(squares) ** 2 / sum(freedoms), (1 + confidence) / 2)
    half = np.nan_to_num(t) * np.sqrt(sum(squares))
    spread = np.sqrt(sum(variances))
    return Interval(value, value - half, value + half), np.where(spread > 0, spread, np.inf)


def permutation_test(x: Array, y: Array, paired: bool) -> Any:
    """Return the exact p-value that two sides are alike, by the difference of their means.

    All ways to deal the numbers out to two sides, or to swap the sides of pairs (Fisher 1935),
    are as likely; beyond `RESAMPLES` ways, so many are drawn. It is NaN for few numbers, too.
    """
    from scipy import stats  # slow to import

    def distance(x: Array, y: Array, axis: int) -> Any:
        return abs(x.mean(axis=axis) - y.mean(axis=axis))

    how: Any = {"permutation_type": "samples" if paired else "independent", "axis": -1, "rng": 0}
    how |= {"n_resamples": RESAMPLES, "alternative": "greater", "vectorized": True}
    is_enough = min(x.shape[-1], y.shape[-1]) >= FEWEST
    return stats.permutation_test((x, y), distance, **how).pvalue if is_enough else math.nan


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


def listed_in(path: Any) -> list[ListedFlight]:
    """Return a recording, or those in a folder that is no bag, or in a list."""
    folder = path_from("paths", path)
    if is_list(folder):
        return read_list(folder)
    is_one = not folder.is_dir() or (folder / "metadata.yaml").exists()
    return [ListedFlight(file) for file in ([folder] if is_one else recordings_in(folder))]


def sides_of_a_list(
    path: Path, paths: Sequence[Any], law: str, against: Sequence[Any], pair: bool
) -> tuple[list[list[ListedFlight]], bool]:
    """Return the flights of two laws of a list, and whether they are in pairs, which are in order.

    Raises
    ------
    EqtError
        If the laws are not clear, or a pair is not complete.
    """
    flights = read_list(path)
    laws = [*dict.fromkeys(x.law for x in flights if x.law)]
    names = ", ".join(laws) or "none; write it into its column law"
    if len(paths) > 1:
        raise EqtError(f"{path}: a list of flights stands alone; got {len(paths)} files")
    wanted = [f"{x}" for x in against]
    if len(wanted) != 1 or wanted[0] not in laws:
        got = ", ".join(wanted) or "none"
        raise EqtError(f"against: expected a law of {path} ({names}), got {got}")
    others = [x for x in laws if x != wanted[0]]
    if not law and len(others) != 1:
        raise EqtError(f"law: name the law of A; {path} has {names}")
    if (law or others[0]) not in others:
        raise EqtError(f"law: expected another law of {path} ({', '.join(others)}), got {law}")
    sides = [[x for x in flights if x.law == one] for one in (law or others[0], wanted[0])]
    if not (pair or all(x.pair for side in sides for x in side)):
        return sides, False
    for side, other in (sides, sides[::-1]):
        counts, there = Counter(x.pair for x in side), {x.pair for x in other}
        for x in side:
            if not x.pair or counts[x.pair] > 1 or x.pair not in there:
                why = f"expected one flight of law {other[0].law} and one of {x.law} in a pair"
                raise EqtError(f"{x.place}: pair: {why}, got '{x.pair}'; empty the column of all")
    order = [x.pair for x in sides[0]]
    return [sides[0], sorted(sides[1], key=lambda x: order.index(x.pair))], True


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
    which = {"eqt": __version__} | {name: _content(value) for name, value in how.items()}
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


def _content(value: Any) -> str:
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
        parts = {name: _content(value) for name, value in one.how.items()}
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
        Their ratio with its 95 % interval; NaN for fewer than `FEWEST` flights.
    p
        Of `permutation_test`, adjusted after Holm (1979) for all quantities.
    word, decided
        The word for A by the interval, and whether it stands: *better* and *worse* need the test.
    needed
        Flights of a side, or pairs, whose interval excludes 1 with probability 0.8, if the ratio is
        as measured.
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

    def __str__(self) -> str:
        """``−19 % [−30, −6], better``."""
        digits = 0 if self.high - self.low > 0.05 else 1
        value, *ends = (fixed(100 * x - 100, digits, signed=True) for x in self[4:7])
        change = f"{value} % [{', '.join(ends)}]".removesuffix(" [-, -]").replace("-", "−")
        word = f", {self.word if self.decided else Word.UNDECIDED}"
        more = f"; {self.needed} of each would decide" if self.needed and not self.decided else ""
        return change if math.isnan(self.low) else change + word + more


def least_pairs(tests: int) -> int:
    """Return the pairs that may decide so many tests: if all go one way, p = 2/2^n."""
    return math.ceil(math.log2(2 * tests / (1 - CONFIDENCE)))


def ratios(errors: Errors, paired: bool, negligible: float) -> Iterator[FlightRatio]:
    """Yield the ratio of the errors of A and B for each quantity."""
    rows = [(q, np.log(x), np.log(y)) for q, (x, y) in errors.items()]
    tests = [permutation_test(x, y, paired) for _, x, y in rows]
    for (q, x, y), p in zip(rows, holm(np.array(tests)).tolist(), strict=True):
        ends, spread = difference(x, y, paired, CONFIDENCE)
        word = Word.BETTER if ends.high < 0 else Word.WORSE if ends.low > 0 else Word.UNDECIDED
        is_alike = max(-math.expm1(ends.low), math.expm1(ends.high)) <= negligible
        decided = is_alike or (word is not Word.UNDECIDED and p <= 1 - CONFIDENCE)
        numbers = (math.exp(number) for number in (x.mean(), y.mean(), *ends))
        word = Word.ALIKE if is_alike else word
        least = least_pairs(len(errors)) if paired else FEWEST
        needed = runs_to_decide(ends.value / spread, CONFIDENCE)
        if needed is not None:
            more = 0 if decided else min(len(x), len(y)) + 1
            needed = max(needed, least, more)
        row: Any = q, QUANTITIES[q][0], *numbers, p, word, decided, needed
        yield FlightRatio(*row)


def finding(rule: gate.Rule, errors: Errors, paired: bool) -> gate.Finding:
    """Return what the one-sided bounds of a change say of a rule."""
    if rule.metric not in errors:
        raise EqtError(f"fail_on: '{rule}': expected one of {', '.join(errors)}")
    x, y = errors[rule.metric]
    factor, is_relative = rule.factor(QUANTITIES[rule.metric][0]), rule.unit == "%"
    margin = rule.margin / factor
    if is_relative:
        x, y, margin = np.log(x), np.log(y), math.log1p(margin)
    change, spread = difference(x, y, paired, gate.TWO_SIDED)
    ends = (factor * (math.expm1(end) if is_relative else float(end)) for end in change)
    facts: Any = {"noun": "pair" if paired else "flight", "names": {"metric": rule.metric}}
    n, needed = min(len(x), len(y)), runs_to_decide(margin / spread, gate.TWO_SIDED)
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


def remarks(n: int, m: int, paired: bool, tests: int) -> Iterator[str]:
    """Yield what limits the words, and what the numbers are."""
    least = least_pairs(tests)
    if n == m == 1:
        yield "this compares two flights, not two settings"
    elif paired and n < least:
        fewer = ", or fewer quantities (--metric)" if tests > 1 else ""
        none = "no interval below 5; " if n < FEWEST else ""
        yield f"{n} pairs: {none}{least} are the least for better or worse{fewer}"
    elif min(n, m) < FEWEST:
        advice = "pairs flown in the same hour need far fewer"
        yield f"{n} and {m} flights: no interval and no words below {FEWEST} each; {advice}"
    by = "pairs, by Student's t" if paired else "flights, by Welch's t"
    yield f"A, B: geometric means; 95 % intervals over {by} of logarithms; p: exact test"


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
    paired: bool,
    metrics: Sequence[str],
    negligible: float,
    every: bool,
    rules: Sequence[gate.Rule],
) -> FlightComparison:
    """Compare the flights of both sides by the quantities that all have.

    Raises
    ------
    EqtError
        If there is none, or a rule does not fit them.
    """
    sides = [[x for x in flights if x.side == side] for side in "AB"]
    lacking = {q: [x.file for x in flights if q not in x.errors] for q in metrics or QUANTITIES}
    shared = [q for q, some in lacking.items() if not some]
    errors = {q: [np.array([x.errors[q] for x in side]) for side in sides] for q in shared}
    most = len(flights) + bool(metrics)  # what nobody has and nobody asked for is not told
    notes = [f"{q}: left out, as {x[0]} has none" for q, x in lacking.items() if 0 < len(x) < most]
    if not shared:
        raise EqtError(f"no quantity that all flights have; {'; '.join(notes)}")
    notes += remarks(len(sides[0]), len(sides[1]), paired, len(shared))
    pairs = [*ratios(errors, paired, negligible)]
    findings = [finding(rule, errors, paired) for rule in rules if rule.margin < math.inf]
    for rule in (rule for rule in rules if rule.margin == math.inf):
        if rule.metric == "failed" or min(map(len, sides)) < FEWEST:
            needs = f"worse needs {FEWEST} flights of each side, and failed is of runs"
            raise EqtError(f"fail_on: {needs}; try 'position worse by 10 %'")
        worse = (x for x in pairs if x.decided and x.word is Word.WORSE)
        findings += [gate.Finding(rule, x.metric, why=f"{x}") for x in worse]
    differing = premises(sides, every)
    return FlightComparison(flights, pairs, *differing, notes, findings, paired)
