"""Names files of other programs by their first bytes, and says what reads them."""

import re
from contextlib import suppress
from pathlib import Path

from eqt_cli.base.errors import InputError
from eqt_cli.base.files import open_regular

_BY_NAME = "eqt itself: give it a name that ends in {}"

# Formats of other programs by their first bytes, with a tool that makes tables of them.
_FOREIGN = (
    (rb"#ROSBAG", "a bag of ROS 1", _BY_NAME.format(".bag")),
    (rb"\x89MCAP", "an MCAP file", _BY_NAME.format(".mcap")),
    (rb"SQLite", "SQLite, as bags of ROS 2 are", _BY_NAME.format(".db3")),
    (rb"\xa3\x95", "an ArduPilot log", _BY_NAME.format(".bin")),
    (rb"ULog\x01", "a PX4 flight", _BY_NAME.format(".ulg")),
    (rb"\x93NUMPY|PK\x03\x04.{26}[^\0]*\.npy", "a NumPy file", "numpy.load and numpy.savetxt"),
    (rb"PK\x03\x04", "a zip archive or a workbook", "unzip, or a spreadsheet"),
    (rb"\x1f\x8b", "a gzip archive", "gunzip"),
    (rb"MATLAB 5", "a MAT-file of MATLAB 5", "writetable of MATLAB, or scipy.io.loadmat"),
    (rb"MATLAB 7\.3", "a MAT-file of MATLAB 7.3", "writetable of MATLAB, or h5py"),
    (rb"\x89HDF", "an HDF5 file", "h5py and numpy.savetxt"),
)


def require_text(path: Path) -> None:
    """Raise an `InputError` for a file that is known to be no text."""
    with suppress(OSError, ValueError), open_regular(path) as stream:  # whoever reads reports them
        begin = stream.read(512)
        for start, title, tool in _FOREIGN:
            if re.match(start, begin, re.DOTALL):
                raise InputError(f"{path}: is {title}, not text; convert it to a table with {tool}")
