"""Stability margins of linearised loops: eigenvalues, delay margins and gain margins."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.api.loading import Configuration, experiment_at
from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError, Problems
from eqt_cli.base.registry import blamed
from eqt_cli.base.reporting import InNotebook, reporter, step
from eqt_cli.components.laws import RunsCode
from eqt_cli.components.vehicle import navigates
from eqt_cli.config.document import changed_at
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import along_reference, remark_on
from eqt_cli.config.study import Study
from eqt_cli.engines.horizon import check_reference
from eqt_cli.extensions.proofs.certified import LawRates, box_of, check_push_and_start, rates_of
from eqt_cli.extensions.proofs.scaled import FACTOR_STEP, LARGEST_FACTOR, ScaledLoop, multiplied
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.growth import DERIVATIVE, Along, Growth, growth, left_out, size_of
from eqt_cli.loop.linearised import AT_REST, MOST_STATES, Linearised, linearised, off_limits

PER_DECADE = 60
"""Frequencies per decade at which the gain is evaluated, besides those near poles."""

NEAR_A_POLE = np.array([-30, -10, -3, -1, -0.3, 0.0, 0.3, 1, 3, 10, 30])
"""Offsets from the frequency of a pole, in units of its decay rate, for more frequencies."""

SLOWEST = 1e-4
"""Lowest searched frequency, as a share of the slowest pole that is not at the origin."""

AT_ORIGIN = 1e-8
"""Poles slower than this share of the fastest one are at the origin, but for rounding."""

BISECTIONS = 45
"""Number of bisections of a frequency interval, down to rounding."""

SAME = 1e-7
"""Tolerance for equal moduli and for whole numbers of periods."""

TRIED = 20
"""Numbers of periods that are all tried. A root may cross the boundary twice between two of them;
then crossings alone do not say which number is the first unstable one."""

SLOW = 0.1
"""Largest change of an eigenvalue, relative to its distance from an integrator's, for which a loop
counts as frozen. Margins of gains change by about as much."""

ROUNDING = 1e-12
"""Distance of eigenvalues from the edge of stability within which rounding decides the side."""


class CutLoop(NamedTuple):
    """An open loop ẋ = A x + B u, y = C x, or its map over one period; u = y closes the loop.

    Attributes
    ----------
    period
        Period of a sampled loop, s; None for a continuous loop.
    """

    A: Array
    B: Array
    C: Array
    period: float | None

    def gain(self, frequency: Array) -> Array:
        """Return G = C (p − A)⁻¹ B, p = iω, or e^(iωT) for a sampled loop, ``(k, m, m)``."""
        p = 1j * frequency if self.period is None else np.exp(1j * frequency * self.period)
        return self.C @ np.linalg.solve(p[:, None, None] * np.eye(len(self.A)) - self.A, self.B)


def delay_margin(loop: CutLoop) -> float:
    """Return the smallest added delay that makes a stable loop unstable, s; infinite if none does.

    A delay τ of the command puts a root at p = iω, or e^(iωT), if an eigenvalue λ of the gain G is
    e^(iωτ), that is |λ| = 1 and τ = arg λ / ω. The margin is the smallest such τ over all
    frequencies. For a single command it is the phase margin divided by the crossover frequency. The
    documentation page on margins derives this.

    For a sampled loop the margin is the largest whole number of periods with which the loop is
    stable: each of the first `TRIED` numbers is tried; beyond these, the numbers on both sides of
    every crossing.
    """
    delays = sorted(_delays(loop))
    if loop.period is None:
        return delays[0] if delays else np.inf
    phases = [(loop.A, loop.B, loop.C)]
    for count in range(1, TRIED + 1):
        if not is_stable(phases, count):
            return (count - 1) * loop.period
    for delay in delays:
        periods = int(np.ceil(delay / loop.period - SAME)) - 1
        if periods < count:
            continue
        if not is_stable(phases, periods):  # a crossing was missed
            first = next(n for n in range(count, periods + 1) if not is_stable(phases, n))
            return (first - 1) * loop.period
        count = int(np.floor(delay / loop.period + SAME)) + 1  # at the crossing, rounding decides
        if not is_stable(phases, count):
            return periods * loop.period
    return np.inf


def delayed(phases: Sequence[tuple[Array, Array, Array]], periods: int) -> Array:
    """Return the map over a cycle of a sampled loop whose commands wait so many periods, 1 or more.

    Parameters
    ----------
    phases
        A, B and C of the map over each period of the cycle, ``(…, n, n)`` and so on.
    """
    A, B, _ = phases[0]
    *_, n, m = B.shape
    matrix = np.broadcast_to(np.eye(n + periods * m), (*A.shape[:-2], *2 * [n + periods * m]))
    for A, B, C in phases:
        x, queue = matrix[..., :n, :], matrix[..., n:, :]
        matrix = np.concatenate([A @ x + B @ queue[..., :m, :], queue[..., m:, :], C @ x], axis=-2)
    return matrix


def is_stable(phases: Sequence[tuple[Array, Array, Array]], periods: int) -> bool:
    """Whether such a loop is stable, at all times."""
    return bool(np.abs(np.linalg.eigvals(delayed(phases, periods))).max() <= 1.0 - ROUNDING)


def _delays(loop: CutLoop) -> Iterator[float]:
    """Yield all delays that put a root on the stability boundary."""
    frequencies = _frequencies(loop)
    above = _moduli(loop, frequencies) > 1.0
    index, place = np.nonzero(above[:-1] != above[1:])
    low, high, before = frequencies[index], frequencies[index + 1], above[index, place]
    for _ in range(BISECTIONS):
        middle = np.sqrt(low * high)
        is_low = (_moduli(loop, middle)[np.arange(len(place)), place] > 1.0) == before
        low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
    for crossing, values in zip(low, np.linalg.eigvals(loop.gain(low)), strict=True):
        phases = np.angle(values[np.abs(np.abs(values) - 1.0) < SAME])
        yield from (phases % (2 * np.pi) / crossing).tolist()


def _moduli(loop: CutLoop, frequencies: Array) -> Array:
    """Return the sorted moduli of the eigenvalues of the gain, ``(k, m)``."""
    return np.sort(np.abs(np.linalg.eigvals(loop.gain(frequencies))), axis=-1)


def _frequencies(loop: CutLoop) -> Array:
    """Return frequencies from below the slowest pole to a gain below 1, dense near poles."""
    closed = loop.A + loop.B @ loop.C
    # Rounding moves an n-fold pole at 0, as that from a tilt to a position, by its n-th root.
    sizes = np.abs(np.concatenate([loop.A, closed], axis=1)).max(axis=1, keepdims=True)
    sure = np.abs(loop.A) > DERIVATIVE * sizes
    poles = np.concatenate([np.linalg.eigvals(loop.A * sure), np.linalg.eigvals(closed)])
    if loop.period is not None:
        poles = np.log(poles[np.abs(poles) > 0].astype(complex)) / loop.period
        highest = np.pi / loop.period
    else:  # |G| ≤ |B| |C| / (ω − |A|)
        highest = 2 * (_size(loop.A) + _size(loop.B) * _size(loop.C))
    sizes = np.abs(poles)
    lowest = SLOWEST * min(sizes[sizes > AT_ORIGIN * sizes.max()], default=highest)
    count = int(PER_DECADE * np.log10(highest / lowest)) + 2
    near = np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * NEAR_A_POLE
    frequencies = np.concatenate([np.geomspace(lowest, highest, count), near.ravel()])
    return np.unique(frequencies[(frequencies >= lowest) & (frequencies <= highest)])


def _size(matrix: Array) -> float:
    return float(np.linalg.norm(matrix, 2))


GAINS = {"kp": ("kp",), "kd": ("kd",), "both": ("kp", "kd"), "position": ("position",)}
GAINS |= {name: (name,) for name in ("effectiveness", "lag")}
"""Gains that are multiplied together, by the name of the margin. Of a cascade, kp and kd are those
of its attitude law. The lag is the one that a law believes in."""

LAGS = 0.5, 2.0
"""Multiples of the believed lag with which delays are tried."""


@dataclass(frozen=True)
class GainMargin:
    """The factors of a gain between which a loop is stable.

    Attributes
    ----------
    lower, upper
        None if the loop is stable down to 1/`LARGEST_FACTOR`, or up to `LARGEST_FACTOR`, or as far
        as it has a derivative within the step of the differences.
    """

    lower: float | None
    upper: float | None


_VERDICTS = {True: "stable", False: "unstable", None: "undecided"}


@dataclass(frozen=True)
class LawMargins:
    """The stability margins of the loop of one law.

    Attributes
    ----------
    label
        Label of the law.
    growth
        Growth of small errors; of a loop that `changes`, at the worst of some times.
    size
        Real part of the largest eigenvalue, 1/s; for a sampled law its modulus.
    changes
        Whether the linearised loop depends on time, in all coordinates that eqt knows. Eigenvalues
        are then no rates and decide nothing.
    delay_is_frozen
        Whether the delay margin is the least of those at single times, because the loop changes in
        the coordinates of its command. It is then indicative.
    is_indicative
        Whether the loop changes, or what is left out could change whether the loop is stable.
    offset : (m,)
        Steady-state error ε with Q = Q_d exp(ε); 0 for a loop that depends on time.
    delay
        Delay margin, s: added delay of the command. For a sampled law, the largest whole number of
        periods with which the loop is stable. Infinite if no delay makes the loop unstable; None
        if the loop is unstable without added delay, or seems so at one of the single times.
    delay_periods
        Delay margin of a sampled law in periods.
    delay_is_least
        Whether the loop is stable with this delay, and longer ones were not tried.
    cycle
        Time after which all sensors of a sampled law, and its position loop, are due together, s.
    left_out
        Places in the configuration of parts that the linear loop leaves out.
    filters
        How the loop has the estimator, in words; "" without one.
    starts
        Whether this is the loop at rest where its reference begins, because the estimator of a
        reference that moves settles there only.
    freezes
        Whether forces have their value there, because the estimator of a loop that changes does not
        settle; the loop hardly changes while its errors decay.
    has_filter
        Whether this is the loop with its estimator, if it has one.
    gains
        Gain margins by the names in `GAINS`, for gains that the law uses; empty if the loop is
        unstable.
    lag_delays
        The delay margins with the `LAGS` of a law that believes in one, s; None where unstable.
    """

    label: str
    growth: Growth
    size: float
    changes: bool
    delay_is_frozen: bool
    is_indicative: bool
    offset: Array
    delay: float | None
    delay_periods: int | None
    delay_is_least: bool
    cycle: float | None
    left_out: list[str]
    filters: str
    starts: bool
    freezes: bool
    has_filter: bool
    gains: dict[str, GainMargin]
    lag_delays: tuple[float | None, ...] = ()

    @property
    def verdict(self) -> str:
        """Whether the loop is stable, in a word."""
        return "indicative" if self.is_indicative else _VERDICTS[self.growth.is_stable]

    def record(self) -> dict[str, Any]:
        """Return the margins for programs."""
        eigenvalue = self.growth.eigenvalue
        return {
            "label": self.label,
            "verdict": self.verdict,
            "largest_eigenvalue": None if self.changes else self.size,
            "eigenvalue": None if self.changes else [eigenvalue.real, eigenvalue.imag],
            "at": self.growth.at if self.changes else None,
            "cycle": self.cycle,
            "estimator": self.filters or None,
            "at_rest_where_it_begins": self.starts,
            "forces_frozen_where_it_begins": self.freezes,
            "growth_rate": None if self.changes else self.growth.rate,
            "offset": self.offset.tolist(),
            "delay_margin": self.delay,
            "delay_margin_periods": self.delay_periods,
            "delay_margin_is_least": self.delay_is_least,
            "delay_margin_is_frozen": self.delay_is_frozen,
            "gain_margins": {name: asdict(gain) for name, gain in self.gains.items()},
            "delay_margins_of_lags": dict(zip(map(str, LAGS), self.lag_delays, strict=False)),
        }

    @property
    def is_unstable(self) -> bool:
        """Whether the loop is certainly unstable."""
        return self.growth.is_stable is False and not self.is_indicative


@dataclass(frozen=True, repr=False)
class Margins(InNotebook):
    """The stability margins of the loops of an experiment.

    Attributes
    ----------
    experiment
        The experiment.
    laws
        Margins of its laws, in their order.
    period
        Control period, s; None if the laws act continuously.
    refused
        Why other laws have no margins, by label.
    """

    experiment: Experiment
    laws: list[LawMargins]
    period: float | None
    refused: dict[str, str] = field(default_factory=dict)

    def answer(self) -> list[str]:
        """Return a line per law: whether it is stable, and its delay margin."""
        titles, lines = self.experiment.titles, []
        for law in self.laws:
            delay = "" if law.delay is None else f", delay margin {law.delay:.4g} s"
            lines.append(f"{titles[law.label]}: {law.verdict}{delay}")
        return lines + [f"{titles[label]}: {why}" for label, why in self.refused.items()]

    def records(self) -> list[dict[str, Any]]:
        """Return a record per law."""
        return [law.record() for law in self.laws]

    @property
    def left_out(self) -> list[str]:
        """Places in the configuration of parts that the linear loops leave out."""
        return list(dict.fromkeys(words for law in self.laws for words in law.left_out))


def margins(
    target: Study | Configuration, *, point: int | None = None, trust_plugins: bool = False
) -> Margins:
    """Compute eigenvalues, delay margin and gain margins of the loop of every law.

    Loops are linearised about their reference, with the hold, the delay and the linear parts of the
    actuators. Limits, quantisation and noise are left out. No run is simulated.

    Parameters
    ----------
    target
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    point
        Point of a sweep, counted from 0. Default: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.

    Returns
    -------
    Margins
        Each of its ``laws`` has ``growth``, ``delay``, ``gains`` and ``is_indicative``: whether the
        linearised loop depends on time, so that these numbers prove nothing.

    Raises
    ------
    ConfigError
        With all problems of the configuration and their places.
    EqtError
        If the file does not exist, or a loop cannot be differentiated.

    Examples
    --------
    >>> [law] = eqt_cli.margins(
    ...     {
    ...         "group": "SO2",
    ...         "inertia": 0.4,
    ...         "gains": {"kp": 1.0, "kd": 0.8},
    ...         "reference": {"kind": "constant"},
    ...         "controllers": ["eqt"],
    ...         "time": {"duration": 10},
    ...     }
    ... ).laws
    >>> law.growth.is_stable, round(law.delay, 4)
    (True, 0.3043)
    """
    experiment = experiment_at(target, point, trust_plugins=trust_plugins)
    remark_on(experiment, runs=False)
    return margins_of(experiment)


@blamed()
def certified(
    target: Study | Configuration,
    velocities: Sequence[float] = (),
    *,
    push: float = 0,
    start: float = 0,
    point: int | None = None,
) -> list[LawRates]:
    """Prove a rate at which small errors decay along every reference whose velocity is bounded.

    About a reference, the errors of the loop obey ẋ = A(V_d) x to first order. One matrix P with
    AᵀP + PA + 2λP ≺ 0 at the corners of a box proves the rate λ for every V_d(t) in the box. The
    proof is in fractions. It needs the extra `certify`.

    Parameters
    ----------
    target
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    velocities
        Each v stands for the box |V_d,i| ≤ v. Default: the box around the reference's own velocity,
        as sampled over the horizon.
    push
        Bound of a wrench, N m: also prove by how much it turns a law on SO(3), to first order.
    start
        Angle, deg: also prove a rate from every start on SO(3) with no more L than a turn by this
        angle at rest. It takes up to a minute for each law and box.
    point
        Point of a sweep, counted from 0. Default: the first.

    Returns
    -------
    list
        For each law its ``label``, and ``rates``, one for each box in rising order, with ``rate``
        (a fraction, 1/s, or None), ``P``, ``overshoot`` √cond P, ``velocity`` (the box),
        ``slowest_constant`` and ``slowest_rate``; and ``gain`` and ``region`` if asked, with their
        proofs. Of a law without, ``refused`` says why.

    Raises
    ------
    ConfigError
        With all problems of the configuration and their places.
    EqtError
        If the file does not exist, or Clarabel is not installed.

    Examples
    --------
    >>> [eqt, *others] = eqt_cli.certified("configs/paper.yaml", [0.5])
    >>> [one] = eqt.rates
    >>> round(float(one.rate), 3), round(one.overshoot, 2)
    (0.119, 1.65)
    """
    experiment = experiment_at(target, point)
    check_push_and_start(push, start)
    bounds = sorted(Fraction(str(v)) for v in set(velocities))
    boxes = [[(-v, v)] * experiment.group.dimension for v in bounds]
    boxes = boxes or [box_of(known_reference(experiment).velocity)]
    with step("laws", len(experiment.loops)):
        loops = experiment.loops.items()
        return [rates_of(label, loop, boxes, push, start) for label, loop in loops]


@purposes.worst_certified
def proved_from(angle: float) -> Callable[[Path, str], str]:
    """Return what says of a law of a configuration what is proved for its starts within an angle.

    Raises
    ------
    EqtError
        If nothing can be proved for this angle, deg, or Clarabel is not installed.
    """
    check_push_and_start(0.0, angle)

    def proved(config: Path, label: str) -> str:
        [law] = (law for law in certified(config, start=angle) if law.label == label)
        return law.refused or str(law.rates[0].region)

    return proved


def known_reference(experiment: Experiment) -> Any:
    """Return the reference over the horizon, after a check that it is finite."""
    shown, problems = experiment.reference_over_horizon(), Problems(experiment.document.place)
    check_reference(shown, None, problems.at("reference"))
    problems.raise_if_any()
    return shown


@blamed()
def margins_of(experiment: Experiment) -> Margins:
    """Compute the margins of every law of an experiment.

    Raises
    ------
    ConfigError
        If the reference is not finite.
    InputError
        If no loop has a derivative about its reference, or each law of no known formula a memory
        that follows a reference; where some have margins, the others are `refused`.
    ComponentError
        If a plugin fails.
    """
    laws, refused = list[LawMargins](), dict[str, str]()
    # One BLAS thread: with several, small matrices take ten times as long.
    with threadpool_limits(1), step("laws", len(experiment.loops)):
        along = along_reference(experiment, known_reference(experiment))
        begun = _where_it_begins(experiment, along)
        shown = begun or experiment
        along = along_reference(shown, known_reference(shown)) if begun else along
        for label, loop in shown.loops.items():
            try:
                laws.append(_of_law(label, loop, along, begun is not None))
            except InputError as error:
                refused[label] = str(error)
            reporter().advance(1)
    if not laws:
        raise InputError(next(iter(refused.values())))
    return Margins(experiment, laws, experiment.loop.period or None, refused)


def _where_it_begins(experiment: Experiment, along: Along) -> Experiment | None:
    """Return the experiment at rest where its reference begins; None where that is not needed.

    An estimator settles at rest only. Without it, the loop of a reference that moves is another.
    """
    vehicle = experiment.loop.vehicle
    if vehicle.estimator is None or navigates(vehicle) or not along.velocities.any():
        return None
    still = {"kind": "constant", "pose": along.poses[0].tolist()}
    try:
        return build(changed_at(experiment.document, ("reference",), still, "at rest"))
    except EqtError:  # a law or a part of the vehicle needs this reference
        return None


def _of_law(label: str, loop: ClosedLoop, along: Along, starts: bool) -> LawMargins:
    if isinstance(law := loop.controller, RunsCode) and law.in_order:
        raise InputError(
            f"'{label}' answers in the order of time of a run only (`object: per run`), and "
            "margins need its answers near the reference; leave this law out"
        )
    linear, freezes = _with_estimator(loop, along)
    if not np.isfinite(linear.closed).all():
        raise InputError(
            f"the loop of '{label}' has no derivative where all errors are 0, for example because "
            "its law jumps there; leave this law out"
        )
    law, changes = off_limits(loop).controller, linear.at_rest is None
    if changes and law.formula is None and law.memory(loop.group):
        raise InputError(
            f"the memory of '{label}' is not known where all errors are 0, because the reference "
            "moves; give a reference that rests, or leave this law out"
        )
    largest, omitted = growth(linear.at_rest or linear), list(left_out(loop, linear))
    delay, is_least = _delay_of(linear, largest)
    gains = _gain_margins(linear) if largest.is_stable else {}
    lagging = [multiplied(linear, ["lag"], factor) for factor in LAGS if "lag" in gains]
    periods = None
    if linear.period is not None and delay is not None and np.isfinite(delay):
        periods = round(delay / linear.period)
    decided = largest.is_stable
    doubts = (omission.destabilises if decided else omission.stabilises for omission in omitted)
    return LawMargins(
        label,
        largest,
        size_of(largest, linear),
        changes,
        not linear.is_constant,
        changes or starts or freezes or (decided is not None and any(doubts)),
        linear.offset[0],
        delay,
        periods,
        is_least,
        linear.cycle,
        [omission.words for omission in omitted],
        _filters(linear, loop),
        starts,
        freezes,
        _has_estimator(loop, linear),
        gains,
        tuple(_delay_of(system, growth(system.at_rest or system))[0] for system in lagging),
    )


def _with_estimator(loop: ClosedLoop, along: Along) -> tuple[Linearised, bool]:
    """Return the linear loop, and whether its forces are frozen so that its estimator settles."""
    linear = linearised(loop, *along, with_estimator=True)
    rests = np.abs(along.velocities).max() <= AT_REST
    if _has_estimator(loop, linear) or navigates(loop.vehicle) or not rests:
        return linear, False
    frozen = linearised(loop, *(values[:1] for values in along), with_estimator=True)
    is_frozen = _has_estimator(loop, frozen) and _changes_slowly(loop, along)
    return (frozen, True) if is_frozen else (linear, False)


def _has_estimator(loop: ClosedLoop, linear: Linearised) -> bool:
    return loop.vehicle.estimator is None or linear.about.loop.vehicle.estimator is not None


def _changes_slowly(loop: ClosedLoop, along: Along) -> bool:
    """Whether a loop at rest is nearly the same while its slowest error falls to 1/e.

    It is judged without its estimator, about where it would rest at each time, by its eigenvalues:
    λ of a continuous loop, and μ − 1 of a sampled one, which are 0 of an integrator.
    """
    from scipy.optimize import linear_sum_assignment  # slow to import

    def frozen(time: float) -> Linearised:
        return linearised(loop, np.array([time]), along.poses[:1], along.velocities[:1])

    first, last = along.times[0], along.times[-1]
    decay = min(1.0 / max(abs(growth(frozen(first)).rate), SLOWEST), last - first)
    edge = 0.0 if loop.vehicle.control is None else 1.0
    for begin in np.linspace(first, last, 3):
        times = begin + decay * np.linspace(0.0, 1.0, 4)
        now, *later = (np.linalg.eigvals(frozen(t).closed[0]) - edge for t in times.tolist())
        sizes = np.abs(now) + AT_ORIGIN * np.abs(now).max()
        for values in later:
            moved = np.abs(now[:, None] - values)
            rows, columns = linear_sum_assignment(moved)
            if not (moved[rows, columns] <= SLOW * sizes[rows]).all():
                return False
    return True


def _filters(linear: Linearised, loop: ClosedLoop) -> str:
    """Say how a linear loop has the estimator of its loop."""
    if loop.vehicle.estimator is None:
        return ""
    about = linear.about
    if about.loop.vehicle.estimator is None:
        return "without the estimator: the law reads the measurements themselves"
    if about.is_settled:
        return "with the estimator, settled at rest"
    return f"with the estimator as it is after {about.settling:.3g} s at rest; it has not settled"


def _delay_of(linear: Linearised, largest: Growth) -> tuple[float | None, bool]:
    """Return the delay margin, s, None if unstable; and whether longer delays were not tried."""
    # The command turns in coordinates at rest; a delay margin is that of its own coordinates.
    is_own = linear.at_rest is None or linear.is_constant
    if not (largest.is_stable and (is_own or growth(linear).is_stable)):
        return None, False
    if len(linear.phases) > 1:
        return _delay_of_cycle(linear)
    [cut] = linear.phases
    matrices = zip(cut.A, cut.B, cut.C, strict=True)
    return min(delay_margin(CutLoop(A, B, C, linear.period)) for A, B, C in matrices), False


def _delay_of_cycle(loop: Linearised) -> tuple[float, bool]:
    """Return the delay margin of a loop whose sensors are slower than its law, s.

    Every number of periods is tried, above `TRIED` in steps of 5 %, and between the last stable and
    the first unstable one all again. Whether longer delays were not tried comes with it.
    """
    assert loop.period is not None
    _, n, m = loop.phases[0].B.shape
    most = max((MOST_STATES - n) // m, TRIED)
    stable = 0
    while stable < most:
        tried = stable + max(1, stable // TRIED)
        if not is_stable(loop.phases, tried):
            first = next(k for k in range(stable + 1, tried + 1) if not is_stable(loop.phases, k))
            return (first - 1) * loop.period, False
        stable = tried
    return stable * loop.period, True


def _gain_margins(loop: Linearised) -> dict[str, GainMargin]:
    """Return the margins of the gains that the law uses."""
    margins = {}
    for which, names in GAINS.items():
        scaled = ScaledLoop(loop, names)
        if scaled.differs:
            ends = (_first_unstable(scaled, step) for step in (1 / FACTOR_STEP, FACTOR_STEP))
            margins[which] = GainMargin(*ends)
    return margins


def _first_unstable(loop: ScaledLoop, step: float) -> float | None:
    """Return the factor nearest to 1 on one side at which the loop becomes unstable, or None."""
    from scipy.optimize import brentq  # slow to import

    stable, end = 0.0, np.log(step)
    while abs(end) <= np.log(LARGEST_FACTOR) * (1 + 1e-12):
        if np.isnan(last := _rate(end, loop)):
            return None
        if last > 0.0:
            # What it calls lives on in a cycle; its arguments do not.
            return float(np.exp(brentq(_rate, stable, end, (loop,), xtol=1e-12)))
        stable, end = end, end + np.log(step)
    return None


def _rate(logarithm: float, loop: ScaledLoop) -> float:
    return loop.rate(float(np.exp(logarithm)))
