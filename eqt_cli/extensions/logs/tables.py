"""Makes tables of texts of other programs, which `tables.yaml` recognises by their first lines.

A quaternion of a frame transformation from A to B (CCSDS 504.0-B-2, STK, Basilisk's sigma_BN) has
the four numbers of Hamilton's rotation that takes coordinates in B to coordinates in A.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, EqtWarning, InputError
from eqt_cli.base.files import content_of, open_regular, text_in, text_of
from eqt_cli.base.reporting import reporter
from eqt_cli.extensions.logs.echoes import crazyflie_as_table, echo_as_table
from eqt_cli.extensions.logs.first_bytes import beginnings, begins, format_of
from eqt_cli.extensions.logs.log_table import CONVERTED

HEAD = 20_000  # characters that show the format of a text
SAMPLED = 0.02  # s between rows that are taken of polynomials
MOST_SAMPLED = 4000  # s that are sampled; 1 kB of memory for each row
ORTHOGONAL = 1e-3  # largest error of RRᵀ of a rotation


@purposes.text_of_a_recording
def text_of_recording(
    path: Path, missing: str, kind: type[EqtError], limit: int, smaller: str
) -> str:
    """Return a recording as the text of a table.

    Raises
    ------
    EqtError
        Of this kind, as by `eqt_cli.base.files.text_of`; an `InputError` for a file that cannot
        be converted.
    """
    if format_of(path):
        from eqt_cli.extensions.logs import logs  # slow to import

        return logs.text_of_recording(path, missing, kind, limit)
    for start, title, tool in beginnings()["foreign"]:
        if begins(path, start):
            raise InputError(
                f"{path}: is {title}, not a table that eqt reads; convert it to a table with {tool}"
            )
    text = text_of(path, missing, kind, limit=limit, smaller=smaller, read=_unicode)
    for name, (title, start) in beginnings()["tables"].items():
        if re.match(start, text[:HEAD]):
            try:
                text = (READERS.get(name) or globals()[f"_{name}"])(text, path)
            except (ValueError, LookupError, AttributeError, StopIteration, csv.Error) as error:
                place = "".join(
                    re.findall(r"(?: with no rotation)? at row \d+, column \d+", f"{error}")
                )
                raise InputError(
                    f"{path}: begins as {title}, but goes on otherwise{place}"
                ) from None
            return with_plain_cells(text, path) if name == "iso" else text
    return with_plain_cells(with_commas(text, path), path)


def _unicode(path: Path, limit: int) -> str:
    """Return the text of a file in UTF-8, or in UTF-16 if its first two bytes say so."""
    if not begins(path, "\xff\xfe|\xfe\xff"):
        return text_in(path, limit)
    return re.sub("\r\n?", "\n", content_of(path, limit).decode("utf-16"))


READERS: dict[str, Any] = {"echo": echo_as_table, "crazyflie": crazyflie_as_table}
"""Readers of `tables.yaml` in another file."""

SEPARATOR = re.compile(r"\ufeff?\"?sep=(.)\"?\n", re.IGNORECASE)
"""A first line for Excel."""


def with_commas(text: str, path: Path) -> str:
    """Return a table as one with commas between columns, and decimals with a point.

    Its columns may be separated by semicolons or tabs, and its decimals have commas.

    Raises
    ------
    InputError
        If commas between digits could separate thousands, or some decimals have a point.
    """
    said = SEPARATOR.match(text)
    body = text[said.end() :] if said else text
    head, _, rows = body.partition("\n")
    apart = said.group(1) if said else next((c for c in ";\t" if c in head and "," not in head), "")
    if not said and not apart:
        return text
    if apart != ",":
        if marks := {*re.findall(r"\d([.,])(?=\d)", rows)}:
            commas = {*re.findall(r"(?<![\d,.])-?\d+,\d+(?![\d,.])", rows)} if "," in marks else {}
            thousands = all(re.fullmatch(r"-?[1-9]\d{0,2},\d{3}", cell) for cell in commas)
            if len(marks) > 1 or (commas and thousands) or ("," in marks and not commas):
                raise InputError(
                    f"{path}: numbers have commas that can separate decimals or thousands; save "
                    "the table with decimal points, without separators of thousands"
                )
        written, table = io.StringIO(), csv.reader(io.StringIO(body), delimiter=apart)
        cells = ([cell.replace(",", ".") for cell in row] for row in table)
        csv.writer(written, lineterminator="\n").writerows(cells)
        body = written.getvalue()
    return f"\n{body}" if said else body  # lines keep their numbers


def _remark(path: Path, words: str) -> None:
    reporter().remark(EqtWarning(f"{path}: {words}"))


def _table(names: str, *columns: Any) -> str:
    """Return a table of numbers."""
    rows = (",".join(map("{:.16g}".format, row)) for row in zip(*columns, strict=True))
    return "\n".join([CONVERTED, names, *rows, ""])


def _numbers(rows: Sequence[str], places: Sequence[int]) -> Array:
    """Return some columns of comma-separated rows; NaN where a cell is empty."""
    read: Any = {k: lambda cell: float(cell.strip() or "nan") for k in places}
    return np.loadtxt(rows, delimiter=",", usecols=places, ndmin=2, converters=read, quotechar='"')


def _quaternions(form: str, numbers: Array) -> Array:
    """Return the quaternions x, y, z, w of rotations in another form; NaN where one is missing."""
    from scipy.spatial.transform import Rotation  # slow to import

    q, whole = np.full((len(numbers), 4), np.nan), np.isfinite(numbers).all(axis=1)
    rows = numbers[whole]
    if form == "euler":
        q[whole] = Rotation.from_euler("XYZ", rows).as_quat()
    elif form == "mrp":
        q[whole] = Rotation.from_mrp(rows).as_quat()
    else:
        R = rows.reshape(-1, 3, 3)
        off = abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) > ORTHOGONAL
        for k in np.flatnonzero(whole)[off | (np.linalg.det(R) < 0)][:1]:
            raise ValueError(f" with no rotation at row {k}, column 0")
        sign = -1 if form == "cosines" else 1
        q[whole] = Rotation.from_matrix(R).as_quat() * [sign, sign, sign, 1]
    return q


def with_columns(text: str, names: str, columns: Array) -> str:
    """Return a table with further columns; its lines keep their numbers."""
    (head, *lines), cells = text.removeprefix(f"{CONVERTED}\n").splitlines(), iter(columns.tolist())
    rows = [",".join([x, *map(repr, next(cells))]) if x.strip() else x for x in lines]
    return "\n".join([f"{head},{names}", *rows, ""])


def _with_heads(text: str, start: str) -> tuple[list[list[str]], list[str], list[str]]:
    """Return the rows to the header, the body of each column, and the rest."""
    lines = text.splitlines()
    at = next(k for k, line in enumerate(lines) if line.replace('"', "").startswith(start))
    heads = [[cell.strip() for cell in row] for row in csv.reader(lines[: at + 1])]
    names = next((row for row in heads if row[1:2] == ["Name"]), heads[-2])
    names = [cell.replace(",", " ") for cell in names]
    for k in range(3, len(names)):  # Vicon names a body once
        names[k] = names[k] or names[k - 1]
    return heads, names + names[-1:] * (len(heads[-1]) - len(names)), lines[at + 1 :]


def _motive(text: str, path: Path) -> str:
    """Read a take of Motive; https://docs.optitrack.com/motive/data-export/data-export-csv."""
    heads, names, rows = _with_heads(text, "Frame,Time")
    facts = dict(zip(heads[0], heads[0][1:], strict=False))
    if facts.get("Rotation Type", "Quaternion") != "Quaternion":
        raise InputError(f"{path}: holds Euler angles; export it with Rotation Type: Quaternion")
    unit = {"Meters": "m", "Centimeters": "cm", "Millimeters": "mm"}[facts["Length Units"]]
    columns = list(zip(names, heads[-2], heads[-1], strict=True))[2:]
    turned = (name for name, kind, _ in columns if kind == "Rotation")
    body, headings = next(turned, columns[0][0]), ["frame,t (s)"]  # without one, a marker
    for name, kind, axis in columns:
        eqt = {"Rotation": f"q{axis}", "Position": f"{axis} ({unit})"}.get(kind, "")
        headings.append(eqt.lower() if eqt and name == body else f"{name} {kind} {axis}".strip())
    turn, bodies = "{rotvec: [90 deg, 0, 0]}", ", ".join(dict.fromkeys(names[2:]))
    words = f"a take of Motive of {bodies}; body {body} is read. If y was up in Motive, "
    _remark(path, f"{words}`{{origin: {turn}, sensor: {turn}}}` in the mapping turns it to z")
    return "\n".join([CONVERTED, *[""] * (len(heads) - 2), ",".join(headings), *rows, ""])


def _vicon(text: str, path: Path) -> str:
    """Read objects of Vicon; https://docs.vicon.com/display/Nexus26/ASCII+files, "Global Angle"."""
    heads, names, (units, *rows) = _with_heads(text, "Frame,Sub Frame")
    first = heads[-1].index("TX")
    body, unit = names[first], units.split(",")[first].strip()
    rows = rows[: next((k for k, row in enumerate(rows) if not row.strip(" ,")), len(rows))]
    columns = enumerate(zip(heads[-1], names, strict=True))
    place = {heading: k for k, (heading, name) in columns if name == body}
    numbers = _numbers(rows, [0, *(place[f"{kind}{axis}"] for kind in "RT" for axis in "XYZ")])
    if "RW" in place:
        q = np.c_[numbers[:, 1:4], _numbers(rows, [place["RW"]])]
    else:
        to_rad = np.pi / 180 if units.split(",")[place["RX"]].strip() == "deg" else 1.0
        q = _quaternions("euler", to_rad * numbers[:, 1:4])
        words = "are read as Euler angles XYZ; export quaternions if they are helical angles"
        _remark(path, f"RX, RY, RZ of {body} {words}")
    names_of = f"t (s),x ({unit}),y ({unit}),z ({unit}),qx,qy,qz,qw"
    return _table(names_of, numbers[:, 0] / float(heads[1][0]), *numbers[:, 4:].T, *q.T)


def _kitti(text: str, path: Path) -> str:
    """Read poses of KITTI: 3 x 4 matrices by row, times apart, 10 Hz; cvlibs.net/datasets/kitti."""
    T = np.loadtxt(io.StringIO(text), ndmin=2).reshape(-1, 3, 4)
    times = 0.1 * np.arange(len(T))
    try:
        with open_regular(path.with_name("times.txt")) as stream:
            times = np.loadtxt(stream, max_rows=len(T) + 1).reshape(len(T))
    except (OSError, ValueError):
        _remark(path, f"rows are 0.1 s apart, as no times.txt of {len(T)} rows is in its folder")
    q = _quaternions("matrix", T[:, :, :3].reshape(-1, 9))
    return _table("t (s),x,y,z,qx,qy,qz,qw", times, *T[:, :, 3].T, *q.T)


def _sophus(text: str, path: Path) -> str:
    """Put the position first, where a quaternion of norm 1 stands before it."""
    numbers = np.loadtxt(io.StringIO(text), ndmin=2)
    before, after = (abs(np.linalg.norm(numbers[:, k : k + 4], axis=1) - 1) for k in (1, 4))
    if before.max() > 1e-3 or after.max() < 1e-2:
        return text
    _remark(path, "read as t qx qy qz qw x y z, the order of Sophus: columns 2 to 5 have norm 1")
    rows = (" ".join(map("{:.16g}".format, row)) for row in numbers[:, [0, 5, 6, 7, 1, 2, 3, 4]])
    return "\n".join([*rows, ""])


def _nanoseconds(stamp: str) -> int:
    """Return an ISO time since 1970, ns; UTC without an offset."""
    day, clock = re.split("[T ]", stamp.strip(' "'), maxsplit=1)
    if day.count("-") == 1:  # the day of the year, as CCSDS allows
        day = f"{datetime.strptime(day, '%Y-%j').replace(tzinfo=UTC):%Y-%m-%d}"
    time = datetime.fromisoformat(f"{day}T{clock}")
    time = time.replace(tzinfo=time.tzinfo or UTC)
    return (time - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def _iso(text: str, path: Path) -> str:
    head, *rows = csv.reader(text.removeprefix("\ufeff").splitlines())
    k = next(k for k, cell in enumerate(rows[0]) if re.match(r" *\d{4}-\d\d", cell))
    head[k] = re.sub(r"\W.*", "", head[k].strip()) + " (ns)"
    for number, cells in enumerate(rows, 2):
        try:
            cells[k:] = [f"{_nanoseconds(cells[k])}", *cells[k + 1 :]] if any(cells) else []
        except (ValueError, IndexError):
            raise InputError(
                f"{path}:{number}: expected a time as 2024-03-05T10:11:12.5Z"
            ) from None
    return _of_cells([head, *rows])


def _of_cells(rows: Iterable[Sequence[str]]) -> str:
    """Return the text of a table of cells, a line each."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


WITH_UNIT = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.,;:\[\]{}()_+-][^\d\s,;:]*)\s*"
)
"""A number with its unit behind it: ``4.65 °/s``."""

LIST = re.compile(r"\s*\[[^\"]*\]\s*")
"""A cell that holds a list: ``[0.33, -0.07, 2.17]``."""


def with_plain_cells(text: str, path: Path) -> str:
    """Return a table whose cells are numbers, where some hold a list or a number with its unit.

    A list becomes columns, ``p`` those of ``p[0]``, ``p[1]`` and so on; a unit goes to the heading.

    Raises
    ------
    InputError
        If the cells of a column hold lists of other lengths, or other units.
    """
    first_row = text.partition("\n")[2].partition("\n")[0]
    if not re.search(r"[\"°%]|\d ?[^\W\d_eE]", first_row):
        return text
    rows = [*csv.reader(text.removeprefix("\ufeff").splitlines())]
    head, first = rows[:2]
    if head and not head[0].strip():
        head[0] = "row"  # an index, as pandas writes it
    if len(first) != len(head):
        return text
    lists = {k: len(_list_of(cell)) for k, cell in enumerate(first) if LIST.fullmatch(cell)}
    units = {k: match[2] for k, cell in enumerate(first) if (match := WITH_UNIT.fullmatch(cell))}
    if not lists and not units:
        return text
    for number, cells in enumerate(rows[1:], 2):
        if len(cells) == len(head):  # others are told where columns are counted
            try:
                _make_plain(cells, units, lists)
            except _OddCellError as error:
                place, wanted = f"{path}:{number}", f"{error}, as in the first row"
                raise InputError(
                    f"{place}: expected {wanted}, in column {head[error.column]}"
                ) from None
    names = [f"{name} ({units[k]})" if k in units else name for k, name in enumerate(head)]
    for k, count in sorted(lists.items(), reverse=True):
        names[k : k + 1] = [f"{names[k]}[{i}]" for i in range(count)]
    return _of_cells([names, *rows[1:]])


class _OddCellError(ValueError):
    """Raised for a cell of a column that is not what the first row has; it says what that is."""

    def __init__(self, column: int, wanted: str) -> None:
        super().__init__(wanted)
        self.column = column


def _make_plain(cells: list[str], units: Mapping[int, str], lists: Mapping[int, int]) -> None:
    """Make numbers of the cells of a row, in place: by column, their unit or the size of a list."""
    for k, unit in units.items():
        match = WITH_UNIT.fullmatch(cells[k])
        if cells[k].strip() and (match is None or match[2] != unit):
            raise _OddCellError(k, f"a number in {unit}")
        cells[k] = match[1] if match else ""
    for k, count in sorted(lists.items(), reverse=True):
        some = _list_of(cells[k]) if cells[k].strip() else [""] * count
        if len(some) != count:
            raise _OddCellError(k, f"a list of {count} numbers")
        cells[k : k + 1] = some


def _list_of(cell: str) -> list[str]:
    """Return the numbers in a list, also in nested ones and in those that NumPy prints."""
    return re.sub(r"[\[\],;]", " ", cell).split()


def _aem(text: str, path: Path) -> str:
    """Read an attitude ephemeris; CCSDS 504.0-B-1 and B-2."""
    pairs = (line.partition("=") for line in text.splitlines())
    keys = {key.strip(): value.strip() for key, equals, value in pairs if equals}
    if not keys["ATTITUDE_TYPE"].startswith("QUATERNION") or text.count("META_START") > 1:
        raise InputError(f"{path}: expected one segment, of ATTITUDE_TYPE QUATERNION")
    rows = [line.split() for line in text.partition("DATA_START")[2].splitlines()]
    rows = [row for row in rows if row and row[0][0].isdigit()]
    q = np.array([row[1:5] for row in rows], float)
    q = np.roll(q, -(keys.get("QUATERNION_TYPE") == "FIRST"), axis=1)
    if (keys.get("ATTITUDE_DIR") == "B2A") != ("BODY" in keys["REF_FRAME_A"].upper()):
        q = q * [-1, -1, -1, 1]
    return _table("t (ns),qx,qy,qz,qw", [_nanoseconds(row[0]) for row in rows], *q.T)


def _stk(text: str, path: Path) -> str:
    """Read an attitude file of STK; help.agi.com, Attitude File Format (*.a)."""
    _, kind, rest = re.split(r"(?i)AttitudeTime(\w*)", text, maxsplit=1)
    data, _ = re.split("(?i)END", rest, maxsplit=1)
    orders = dict.fromkeys(("quaternions", "quatangvels"), "qx,qy,qz,qw")
    orders["quatscalarfirst"] = "qw,qx,qy,qz"
    if kind.lower() not in orders:
        raise InputError(f"{path}: expected AttitudeTimeQuaternions; export it with quaternions")
    return _table(f"t (s),{orders[kind.lower()]}", *np.loadtxt(io.StringIO(data), ndmin=2).T[:5])


def _polynomials(text: str, path: Path) -> str:
    """Sample x, y, z and yaw of pieces of degree 7; github.com/whoenig/uav_trajectories."""
    pieces = _numbers(text.splitlines()[1:], range(33))
    for k in np.flatnonzero(~((pieces[:, 0] > 0) & (pieces[:, 0] < np.inf)))[:1]:
        got = f"got {pieces[k, 0]:g}"
        raise InputError(f"{path}: piece {k + 1}: expected a duration above 0 s, {got}")
    ends = np.r_[0.0, np.cumsum(pieces[:, 0])]
    if ends[-1] > MOST_SAMPLED:
        limit = f"expected pieces of {MOST_SAMPLED:,} s in all, or less, got {ends[-1]:.4g} s"
        raise InputError(f"{path}: {limit}; cut the trajectory, or check the unit of duration")
    t = np.unique(np.r_[ends, np.arange(0.0, ends[-1], SAMPLED)])
    t = t[np.diff(t, prepend=-1.0) > SAMPLED / 100]
    piece = np.clip(np.searchsorted(ends, t, side="right") - 1, 0, len(pieces) - 1)
    a, u, k = pieces[piece, 1:].reshape(-1, 4, 8), (t - ends[piece])[:, None, None], np.arange(8)
    place, speed = (a * u**k).sum(-1).T, (a * k * u ** np.maximum(k - 1, 0)).sum(-1).T
    names = "t (s),x (m),y (m),z (m),yaw (rad),pitch (rad),roll (rad),vx (m/s),vy (m/s),vz (m/s)"
    return _table(names, t, *place, 0 * t, 0 * t, *speed[:3])


def _blackbox(text: str, path: Path) -> str:
    """Add columns of eqt; github.com/betaflight/blackbox-tools has roll, pitch, heading in deg."""
    head, rest = text.split("\n", 1)
    names = [re.sub(r"\(.*", "", heading).strip() for heading in head.split(",")]
    unit = "rad/s" if "gyroADC[0] (rad/s)" in head else "deg/s"
    added = {"time": "t (us)", "heading": "yaw (deg)"}
    added |= {f"gyroADC[{k}]": f"w{axis} ({unit})" for k, axis in enumerate("xyz")}
    head = re.sub(r"\b(roll|pitch)\b(?! *\()", r"\1 (deg)", head)
    present = [name for name in added if name in names]
    numbers = _numbers(rest.splitlines(), [names.index(name) for name in present])
    return with_columns(f"{head}\n{rest}", ",".join(added[name] for name in present), numbers)


def _rotations(text: str, path: Path) -> str:
    """Add the quaternions of rotations in another form."""
    head, *rows = text.splitlines()
    names = [re.sub(r"[ (].*", "", entry.strip()) for entry in head.split(",")]
    for form, pattern, count, words in beginnings()["rotations"]:
        places = [k for k, name in enumerate(names) if re.fullmatch(pattern, name)]
        if len(places) == count:
            _remark(path, words)
            return with_columns(text, "qx,qy,qz,qw", _quaternions(form, _numbers(rows, places)))
    return text
