"""Puts what was recorded into one frame: twists of a body, and axes of ROS beside PX4's."""

from typing import Any

import numpy as np

from eqt_cli.components.log_table import LogMapping
from eqt_cli.extensions.recordings.delay import turns

WINDOW = 0.25
"""Time to each side over which a velocity is compared with the change of the poses, s."""

CLEARLY = 2.0
"""Ratio of the misfits beyond which the poses tell the frame, and not the name of the topic."""


def of_twist(quantity: str, twist: Any, position: Any, attitude: Any) -> Any:
    """Return a velocity in space, or rates in the body, from a twist whose frame is not known.

    Parameters
    ----------
    twist, position, attitude
        As `logs.Series`. The integral of the twist in space is the change of the poses.
    """
    times, x = twist.times, twist.numbers
    R = turns(attitude.at(times))
    known = np.isfinite(attitude.at(times)).all(axis=1)
    early, late = times - WINDOW, times + WINDOW
    if quantity == "rates":
        change = (turns(attitude.at(late)) * turns(attitude.at(early)).inv()).as_rotvec()
        change += 0 * (attitude.at(late) + attitude.at(early))[:, 1:]  # NaN stays NaN
    else:
        change = position.at(late) - position.at(early)
    misfits = []
    for numbers in (x, R.apply(x)):
        areas = (numbers[1:] + numbers[:-1]) / 2 * np.diff(times)[:, None]
        integral = np.concatenate([np.zeros((1, 3)), np.cumsum(areas, axis=0)])
        passed = [
            np.column_stack([np.interp(t, times, c) for c in integral.T]) for t in (late, early)
        ]
        misfits.append(np.nanmean((passed[0] - passed[1] - change)[known] ** 2))
    in_space, in_body = np.sqrt(misfits)
    is_of_body = quantity == "rates" or "body" in twist.topic
    if max(in_space, in_body) > CLEARLY * min(in_space, in_body):
        is_of_body = in_body < in_space
    if is_of_body == (quantity == "rates"):
        return twist
    turned = R.inv().apply(x) if quantity == "rates" else R.apply(x)
    heading = f"{twist.topic} (turned {'into' if quantity == 'rates' else 'from'} the body)"
    return twist._replace(topic=heading, times=times[known], numbers=turned[known])


def in_axes(quantity: str, series: Any, mapping: LogMapping) -> Any:
    """Return a series in the axes to which a mapping turns those that it has."""
    if not series.axes or series.axes != (mapping.world or "")[:3]:
        return series
    A, B, numbers = mapping.axes("world"), mapping.axes("body"), series.numbers
    if quantity == "attitude":
        R = A @ turns(numbers).as_matrix() @ B.T
        numbers = type(turns(numbers)).from_matrix(R).as_quat(scalar_first=True)
    else:
        numbers = numbers @ (B if quantity == "rates" else A).T
    return series._replace(numbers=numbers, axes=(mapping.world or "")[-3:])
