"""Puts what was recorded into one frame: twists of a body, and axes of ROS beside PX4's."""

from typing import Any

import numpy as np

from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.extensions.logs.delay import apart, turns

TRANSFORM = [f"transform.translation.{axis}" for axis in "xyz"]
TRANSFORM += [f"transform.rotation.{axis}" for axis in "wxyz"]
"""Fields of a transform: its translation and its quaternion."""

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
    from scipy.integrate import cumulative_trapezoid  # slow to import
    from scipy.interpolate import make_interp_spline

    times, x = twist.times, twist.numbers
    R = turns(attitude.at(times))
    finite = np.isfinite(attitude.at(times)).all(axis=1)
    early, late = times - WINDOW, times + WINDOW
    poses = attitude if quantity == "rates" else position
    change = apart(poses.at(late), poses.at(early))
    if quantity == "rates":
        change = turns(attitude.at(early)).apply(change)
    misfits = []
    for numbers in (x, R.apply(x)):
        path = cumulative_trapezoid(numbers, times, axis=0, initial=0)
        passed = make_interp_spline(times, path, k=1)
        misfits.append(np.nanmean((passed(late) - passed(early) - change)[finite] ** 2))
    in_space, in_body = np.sqrt(misfits)
    is_of_body = quantity == "rates" or "body" in twist.topic
    if max(in_space, in_body) > CLEARLY * min(in_space, in_body):
        is_of_body = in_body < in_space
    if is_of_body == (quantity == "rates"):
        return twist
    turned = R.inv().apply(x) if quantity == "rates" else R.apply(x)
    heading = f"{twist.topic} (turned {'into' if quantity == 'rates' else 'from'} the body)"
    return twist._replace(topic=heading, times=times[finite], numbers=turned[finite])


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


def composed(topics: list[Any], name: str) -> Any:
    """Return the pose of a frame in another one along a tree of transforms; None without a path.

    Parameters
    ----------
    topics
        Topics of pairs of frames, ``/tf map.odom``, as `readers.Topic`.
    name
        ``/tf map.base_link``: between changes, transforms are interpolated.
    """
    from scipy.spatial.transform import Slerp  # slow to import

    parent, _, child = name.rpartition(" ")[2].partition(".")
    links = {t.name.partition(".")[2]: t for t in topics if " " in t.name and len(t.times)}
    path = list[Any]()
    while child != parent and child in links and len(path) <= len(links):
        path.append(links[child])
        child = links[child].name.rpartition(" ")[2].partition(".")[0]
    moving = [link.times for link in path if len(link.times) > 1]
    if child != parent or not moving:
        return None
    times = np.unique(moving[0])  # those of the link next to the body
    times = times[(times >= max(t[0] for t in moving)) & (times <= min(t[-1] for t in moving))]
    p, R = np.zeros((len(times), 3)), turns(np.tile([1.0, 0, 0, 0], (len(times), 1)))
    for link in path:
        stamps, rows = np.unique(link.times, return_index=True)
        t, s = (times - stamps[0]) / 1e9, (stamps - stamps[0]) / 1e9
        x, q = np.split(np.stack([link.fields[key][rows] for key in TRANSFORM], axis=-1), [3], 1)
        turn = Slerp(s, turns(q))(t) if len(s) > 1 else turns(q)
        p = np.column_stack([np.interp(t, s, column) for column in x.T]) + turn.apply(p)
        R = turn * R
    numbers = dict(zip(TRANSFORM, [*p.T, *R.as_quat(scalar_first=True).T], strict=True))
    return path[0]._replace(name=name, rows=len(times), times=times, fields=numbers)
