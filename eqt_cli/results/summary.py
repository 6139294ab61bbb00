"""What summaries of a result say first: which numbers, of which parts, and whether runs settle."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import suggestion
from eqt_cli.base.stored import Status, signal_of
from eqt_cli.results.metrics import RANKED, SUMMARY
from eqt_cli.results.quantity import Plain, SweptKey
from eqt_cli.results.result import ROUNDING, Result, meaning_of


def own_metrics(result: Result) -> list[str]:
    """Return the stored numbers by formulas of the user's own."""
    return [name for name in result.metrics if result.quantity(name).is_own]


def headlines(result: Result) -> list[str]:
    """Return the numbers of a summary that all runs have, those of parts if units differ.

    The torque is of the first seconds, as in the paper, if its laws fly the paper's loop;
    else it is the mean and the largest one. Settling is there where a rate decides on it.
    """
    without = {"mean_torque", "peak_torque"} if _flies_papers_loop(result) else {"early_torque"}
    if result.has("final_attitude_error"):
        without.add("final_pose_error")
    if result.has("final_pointing_error"):
        without |= {"mean_pose_error", "final_pose_error"}
    settling = result.attributes_of("settling_time") if result.has("settling_time") else {}
    if "threshold_rate" not in settling:
        without.add("settling_time")
    listed = (*own_metrics(result), *(name for name in SUMMARY if name not in without))
    names = [part for name in listed for part in result.in_parts(name)]
    return [name for name in names if name in result.metrics]


def compared_first(result: Result) -> list[str]:
    """Return the stored numbers by which laws are compared first: errors and torque, by parts.

    Errors are ‖p − p_d‖ and the angle of the attitude; ‖I − Q_E‖ of what has neither.
    """
    errors = [row.name for row in RANKED if row.role == "error" and result.has(row.name)]
    parts = result.described.parts if len(result.described.parts) > 1 else []
    if "position_rms" not in errors and (parts or not errors):
        turns = [f"mean_pose_error_{part.name}" for part in parts if part.turns]
        errors += [name for name in result.in_parts("mean_pose_error") if name not in turns]
    torque = "early_torque" if _flies_papers_loop(result) else "mean_torque"
    by_user = [x for x in own_metrics(result) if result.quantity(x).better != "neither"]
    names = (*errors, *result.in_parts(torque), *by_user)
    return [name for name in names if name in result.metrics]


def _flies_papers_loop(result: Result) -> bool:
    return {"eqt", "gt"} <= set(result.kinds.values()) and not result.described.departures


def headline(result: Result) -> list[dict[str, Any]]:
    """Return the summary of every controller: `headlines` over its good runs.

    ``controller``, ``runs``, ``failed`` and of these ``by_rounding``, and the numbers by name,
    or those of their parts if the units differ; NaN if no run is good. Also the number of
    ``settled`` runs and the mean ``saturated_share``, if the result has them.
    """
    summary, names = list[dict[str, Any]](), headlines(result)
    for c, label in enumerate(result.labels):
        good = result.good[..., c, :]
        row: dict[str, Any] = {"controller": label, "runs": good.size}
        row["failed"] = result.failed[label]
        row["by_rounding"] = int(np.count_nonzero(result.status[..., c, :] == Status.BY_ROUNDING))
        for name in names:
            values = result.metric(name, c)[good]
            of = np.max if name == "energy_residual" else np.mean
            row[name] = float(of(values)) if values.size else math.nan
        if result.has("settling_time"):
            times = result.metric("settling_time", c)[good]
            row["settled"] = int(np.count_nonzero(np.isfinite(times)))
        if result.has("saturated_share"):
            shares = result.metric("saturated_share", c)[good]
            row["saturated_share"] = float(np.mean(shares)) if shares.size else math.nan
        summary.append(row)
    return summary


def endings(result: Result) -> dict[str, int]:
    """Return the number of failed runs by kind of failure, the most frequent first."""
    counts = Counter(np.sort(result.status[result.status != 0]).tolist())
    return {meaning_of(code): count for code, count in counts.most_common()}


def settles(result: Result) -> Array | None:
    """Whether each good run ends within the settling threshold, ``(controllers, runs)``.

    A sweep has a leading axis of points. None if the result does not store this.
    """
    # NaN (a failed run) is not settled
    return result.metric("settled") > 0 if "settled" in result.metrics else None


def check_metrics(result: Result, names: Sequence[str], who: str) -> None:
    """Check that numbers per run of these names exist.

    Parameters
    ----------
    who
        Name of the caller for the message: ``figure 'pareto'``.

    Raises
    ------
    EqtError
        With the existing names.
    """
    metrics = result.metrics
    for name in names:
        if name not in metrics:
            hint = suggestion(name, metrics) or f"; there are: {', '.join(metrics)}"
            raise result.error(f"{who} finds no metric '{name}'{hint}")


def unit_in_words(result: Result, name: str) -> str:
    """Return the unit of a number; "" for a pure one, ``N m and N`` for several parts."""
    unit = result.units(name)
    if unit == "mixed" and (parts := part_units(result, name)):
        return " and ".join(parts)
    return "" if unit == "1" else unit


def part_units(result: Result, name: str) -> list[str]:
    """Return the different units of the parts of a norm, as ``["N m", "N"]``.

    Empty if all parts have the same unit.
    """
    quantity = result.quantity(name)
    signal = signal_of(quantity.signals[0] if quantity.signals else name)
    parts = result.described.parts
    if signal is None or len(parts) < 2:
        return []
    units = [signal.unit_in(part) for part in parts]
    # A metric derives its unit from its signal's.
    of = [unit if result.is_over_time(name) else quantity.unit(unit) for unit in units]
    return list(dict.fromkeys(of)) if len(set(of)) > 1 else []


def not_shared(inner: Mapping[str, str | None]) -> list[str]:
    """Return a line on the inner blocks of laws, given by title, where they are not the same."""
    if len({*inner.values()}) < 2:
        return []
    blocks = ", ".join(f"{law} ({kinds or 'none'})" for law, kinds in inner.items())
    return [f"not shared, inner blocks between law and actuators: {blocks}"]


def repeats(result: Result) -> bool:
    """Whether all runs of every law are the first one again, up to rounding."""
    if result.runs < 2 or not result.has("initial_pose"):
        return False
    if result.is_sweep:
        return all(repeats(result.at(point)) for point in range(result.points))
    names = filter(result.has, ("initial_pose", "initial_velocity", *result.metrics))
    of_runs = (np.moveaxis(result.read(name), result.dims(name).index("run"), 0) for name in names)
    return all(np.allclose(x, x[:1], rtol=ROUNDING, equal_nan=True) for x in of_runs)


def owner_of(result: Result, swept: SweptKey) -> str:
    """Return the owner of a key among several controllers, ``" of TITLE"``; else nothing."""
    match = re.match(r"controllers\[(\d+)\]", swept.key)
    if match is None or len(result.labels) < 2 or int(match[1]) >= len(result.titles):
        return ""
    return f" of {result.titles[int(match[1])]}"


def unit_of_key(result: Result, swept: SweptKey) -> str:
    """Return the own unit of a swept key; empty for coordinates with mixed units."""
    # Only sweeps have keys, and `compare` of others loads no expressions.
    from eqt_cli.base.option_types import POSE, STIFFNESS, TORQUE, VELOCITY

    unit = TORQUE if swept.unit_of_key == STIFFNESS else swept.unit_of_key
    if unit in (POSE, VELOCITY):
        return ""
    if not unit.startswith(TORQUE):
        return unit
    torque = result.units("peak_torque") if result.has("peak_torque") else "mixed"
    if torque in ("mixed", "1", ""):
        return ""
    return torque + unit.removeprefix(TORQUE)


def key_in_words(result: Result, swept: SweptKey) -> tuple[str, str]:
    """Return a swept key with its law, as a table heads it, and the unit of its bare numbers."""
    is_bare = swept.is_number and not swept.unit
    unit = Plain().unit(unit_of_key(result, swept)) if is_bare else ""
    return swept.key + owner_of(result, swept), unit
