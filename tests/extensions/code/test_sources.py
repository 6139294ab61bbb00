"""The files beside a law in code, without which its numbers would not be the same."""

import shutil
from hashlib import sha256
from pathlib import Path

import pytest
from said import says

import eqt_cli
from eqt_cli.extensions.code.user_code import UserCode

LAW = """
import sys
sys.path.insert(0, {folder!r})
import helper_of_code
class Law:
    def __init__(self):
        self.gain = float(open({folder!r} + "/gain.txt").read())
    def compute(self, velocity):
        return -velocity * self.gain * helper_of_code.GAIN
"""


def digit(path):
    """A hash as it stands in a result."""
    return sha256(Path(path).read_bytes()).hexdigest()[:16]


@pytest.mark.ci("starts processes of a law")
@pytest.mark.parametrize("each", [None, "per run"])
def test_what_a_law_in_python_imports_and_reads(config, tmp_path, each):
    Path("helper_of_code.py").write_text("GAIN = 1.0\n", encoding="utf-8")
    Path("gain.txt").write_text("1.0", encoding="utf-8")
    Path("law.py").write_text(LAW.format(folder=str(tmp_path)), encoding="utf-8")
    options = {"as": None, "numbers": None, "object": each}
    data = config(file="law.py", function="Law().compute", **options)
    expected = {"gain.txt": digit("gain.txt"), "helper_of_code": digit("helper_of_code.py")}
    assert eqt_cli.load_experiment(data).code == expected


def test_a_header_of_a_variable_is_not_read(config, written, told, tmp_path, monkeypatch):
    """`CPLUS_INCLUDE_PATH` would lead to a header that no result keeps."""
    if not shutil.which("g++"):
        pytest.skip("needs a C++ compiler")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "gains.h").write_text("static const double k = 1.0;", encoding="utf-8")
    monkeypatch.setenv("CPLUS_INCLUDE_PATH", str(tmp_path / "other"))
    written(name="law.cpp", body="", more="#include <gains.h>")
    assert says(told(config(file="law.cpp")), "…law.cpp cannot be compiled: …gains.h…")


def test_headers_of_libraries_are_known_by_their_content(tmp_path):
    """Those of a compiler and of the system come with these."""
    (own := tmp_path / "Dense.h").write_text("int k;", encoding="utf-8")
    brought = ["/usr/include/math.h", "/usr/lib/gcc/x/include/stddef.h", "/opt/clang/19/a.h"]
    lines = [f'# 1 "{path}" 1 3' for path in (*brought, str(own), "law.c", "<built-in>")]
    code = UserCode(
        file="law.c",
        prefix="law",
        numbers=(),
        memory=(),
        real="double",
        text="",
        entries=9,
        axes=3,
        returns=3,
    )
    vars(code)["preprocessed"] = "\n".join(lines)
    assert code.headers == [str(own)]
