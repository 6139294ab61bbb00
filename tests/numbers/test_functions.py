"""The elementary functions in C: their errors against mpmath, special values, and equal bits."""

import ctypes
import itertools
import math
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import mpmath
import numpy as np
import pytest

from eqt_cli.base.arrays import FUNCTIONS
from eqt_cli.numbers import program

FOLDER = Path(program.__file__).parent
HEADER = FOLDER / "functions.h"
NAMES = [*FUNCTIONS, "pow"]
STRICT = "-Wall -Wextra -Werror -pedantic -Wno-psabi -Wno-unused-function".split()
C99, CPP = ["-std=c99"], ["-x", "c++", "-std=c++98", "-Wno-long-long"]
NAN = 0x7FF8000000000000
inf, nan = math.inf, math.nan


def compilers():
    """The C compilers of this machine, as commands."""
    found = [[name] for name in ("gcc", "clang") if shutil.which(name)]
    if not found and shutil.which("cc"):
        found = [["cc"]]
    if not found and find_spec("ziglang"):
        found = [[sys.executable, "-m", "ziglang", "cc"]]
    return found


def source(language=C99):
    """A function `all_NAME` for each, which goes over arrays of lanes."""
    exported = 'extern "C"' if language is CPP else ""
    lines = ['#include "lanes.h"', '#include "functions.h"', f"#define EXPORTED {exported}"]
    for name in NAMES:
        second, given = (", const eqt_real *z", ", z[i]") if name == "pow" else ("", "")
        lines.append(
            f"EXPORTED void all_{name}(const eqt_real *x{second}, eqt_real *y, long n)\n"
            f"{{ long i; for (i = 0; i < n; i++) y[i] = eqt_{name}(x[i]{given}); }}"
        )
    return "\n".join(lines) + "\n"


class Build:
    """The functions as one compiler translates them."""

    def __init__(self, folder, compiler, lanes, level="-O2", language=C99):
        code, library = folder / "functions.c", folder / "functions.so"
        code.write_text(source(language))
        flags = [*language, *STRICT, level, "-ffp-contract=off", "-fno-math-errno"]
        flags += [f"-DEQT_LANES={lanes}", f"-I{FOLDER}", "-fPIC", "-shared"]
        subprocess.run([*compiler, *flags, str(code), "-o", str(library)], check=True)
        self.lanes, self.library = lanes, ctypes.CDLL(str(library))

    def __call__(self, name, *arguments):
        length = len(arguments[0])
        arrays = [aligned(array) for array in (*arguments, np.zeros(length))]
        addresses = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        count = ctypes.c_long(len(arrays[0]) // self.lanes)
        getattr(self.library, f"all_{name}")(*addresses, count)
        return arrays[-1][:length].copy()


def aligned(array):
    """A copy that starts at a multiple of 64 bytes, with a multiple of 8 numbers."""
    room = np.ones(-(-len(array) // 8) * 8 + 8)
    start = -room.ctypes.data % 64 // 8
    copy = room[start : start + len(room) - 8]
    copy[: len(array)] = array
    return copy


@pytest.fixture(scope="module")
def functions(tmp_path_factory):
    if not compilers():
        pytest.skip("no C compiler on this machine")
    return Build(tmp_path_factory.mktemp("functions"), compilers()[0], 2)


def errors(found, exact):
    """The errors of numbers, in units in the last place of the exact ones."""
    last = [max(mpmath.frexp(each)[1] - 53, -1074) for each in exact]
    return np.array(
        [
            float(abs(mpmath.mpf(float(number)) - each) * mpmath.mpf(2) ** -place)
            for number, each, place in zip(found, exact, last, strict=True)
        ]
    )


def stated_errors():
    rows = re.findall(r"^ +eqt_(\w+) +(\d\.\d+)$", HEADER.read_text(), re.MULTILINE)
    return {name: float(error) for name, error in rows}


def points(name, rng, count=400):
    """Numbers all over the domain of a function, and more of them where it is delicate."""

    def powers(low, high):
        return 10.0 ** rng.uniform(low, high, count)

    signs = rng.choice([-1.0, 1.0], count)
    if name in ("sin", "cos", "tan"):
        turns = rng.integers(1, 2**26, count)
        return [
            *(rng.uniform(-bound, bound, count) for bound in (1.0, 100.0, 1.05e8)),
            *(powers(-300, 0) * signs, turns * (math.pi / 2)),
        ]
    if name in ("asin", "acos", "atanh"):
        return [rng.uniform(-1, 1, count), powers(-300, 0) * signs, 1 - powers(-15, -1)]
    if name in ("sinh", "cosh", "tanh", "exp"):
        most = {"tanh": 22.0, "exp": 708.0}.get(name, 710.4)
        bounds = (0.5, 5.0, most)
        return [*(rng.uniform(-bound, bound, count) for bound in bounds), powers(-300, 0) * signs]
    if name == "acosh":
        return [1 + powers(-15, 2), powers(0, 300), rng.uniform(1, 5, count)]
    if name in ("log", "sqrt"):
        return [powers(-308, 308), rng.uniform(0.5, 2, count), 1 + powers(-15, -1) * signs]
    return [rng.uniform(-5, 5, count), powers(-300, 300) * signs, powers(-3, 3) * signs]


def exact_of(name, arguments, bits=140):
    called = {"pow": mpmath.power, "abs": abs}.get(name) or getattr(mpmath, name)
    with mpmath.workprec(bits):
        return [called(*(mpmath.mpf(float(each)) for each in given)) for given in arguments]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_no_error_is_greater_than_stated(functions, name):
    x = np.concatenate(points(name, np.random.default_rng(7)))
    with mpmath.workprec(140):
        worst = errors(functions(name, x), exact_of(name, zip(x, strict=True))).max()
    assert worst <= stated_errors()[name]
    assert stated_errors()[name] <= 1.1


def test_no_error_of_pow_is_greater_than_stated(functions):
    rng, count = np.random.default_rng(8), 400
    bases = [
        10.0 ** rng.uniform(-300, 300, count),
        1 + rng.uniform(-0.3, 0.3, count),
        1 + 10.0 ** rng.uniform(-15, -2, count),
    ]
    x = np.concatenate([*bases, rng.uniform(0, 10, count)])
    y = np.concatenate(
        [
            *(rng.uniform(-708, 709, count) / np.log(base) for base in bases),
            rng.uniform(-9, 9, count),
        ]
    )
    with mpmath.workprec(140):
        worst = errors(functions("pow", x, y), exact_of("pow", zip(x, y, strict=True))).max()
    assert worst <= stated_errors()["pow"]


def test_the_errors_that_are_stated_are_those_of_all_functions():
    assert sorted(stated_errors()) == sorted(NAMES)


# The doubles of each binade up to 2^27 that are nearest to a multiple of a right angle, as its
# number of right angles; found by trying all of them.
NEAREST = [1, 2, 3, 6, 19, 29, 14479, 29327, 58285, 145897, 204551, 1081409, 9206271]


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_angles_that_are_nearly_right_angles(functions, name):
    turns = [turn * 2**k for turn in NEAREST for k in range(13) if turn * 2**k < 2**27]
    with mpmath.workprec(200):
        x = np.array([float(turn * mpmath.pi / 2) for turn in turns])
        worst = errors(functions(name, x), exact_of(name, zip(x, strict=True), bits=200)).max()
    assert worst <= stated_errors()[name]


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_angles_of_any_size(functions, name):
    rng = np.random.default_rng(9)
    x = np.concatenate(
        [
            10.0 ** rng.uniform(8, 308, 200) * rng.choice([-1, 1], 200),
            10.0 ** rng.uniform(8, 9, 50),
            105414356.5 + np.arange(-20, 20) / 4,
            # 6381956970095103 2^797 is nearest of all doubles (Muller et al. 2018, 11.3.2).
            [math.ldexp(6381956970095103.0, 797), sys.float_info.max],
        ]
    )
    with mpmath.workprec(1300):
        exact = exact_of(name, zip(x, strict=True), bits=1300)
        worst = errors(functions(name, x), exact).max()
    assert worst <= stated_errors()[name]


def test_results_below_the_least_normal_number(functions):
    """Rounded once: at most one unit, which is the least number."""
    x = np.linspace(-745.2, -708.3, 300)
    with mpmath.workprec(140):
        assert errors(functions("exp", x), exact_of("exp", zip(x, strict=True))).max() <= 1
        y = np.linspace(-1074.9, -1022, 300)
        two = np.full(300, 2.0)
        exact = exact_of("pow", zip(two, y, strict=True))
        assert errors(functions("pow", two, y), exact).max() <= 1


def both_signs(*pairs):
    return [pair for x, y in pairs for pair in ((x, y), (-x, -y))]


SPECIAL = {
    "sin": [*both_signs((0.0, 0.0), (5e-324, 5e-324)), (inf, nan), (-inf, nan)],
    "cos": [(0.0, 1.0), (-0.0, 1.0), (5e-324, 1.0), (inf, nan), (-inf, nan)],
    "tan": [*both_signs((0.0, 0.0), (5e-324, 5e-324)), (inf, nan), (-inf, nan)],
    "asin": [*both_signs((0.0, 0.0), (5e-324, 5e-324), (1.0, math.pi / 2)), (1.1, nan)],
    "acos": [(1.0, 0.0), (-1.0, math.pi), (0.0, math.pi / 2), (-1.1, nan), (1.1, nan)],
    "atan": both_signs((0.0, 0.0), (5e-324, 5e-324), (1.0, math.pi / 4), (inf, math.pi / 2)),
    "sinh": both_signs((0.0, 0.0), (5e-324, 5e-324), (710.5, inf), (1e300, inf), (inf, inf)),
    "cosh": [(0.0, 1.0), (-0.0, 1.0), (710.5, inf), (-710.5, inf), (inf, inf), (-inf, inf)],
    "tanh": both_signs((0.0, 0.0), (5e-324, 5e-324), (30.0, 1.0), (1e300, 1.0), (inf, 1.0)),
    "asinh": both_signs((0.0, 0.0), (5e-324, 5e-324), (inf, inf)),
    "acosh": [(1.0, 0.0), (1 - 2**-53, nan), (-inf, nan), (inf, inf)],
    "atanh": [*both_signs((0.0, 0.0), (5e-324, 5e-324), (1.0, inf)), (1.1, nan), (-inf, nan)],
    "exp": [
        *((0.0, 1.0), (-0.0, 1.0), (inf, inf), (-inf, 0.0), (1e300, inf), (-1e300, 0.0)),
        *((709.782712893384, 1.7976931348622732e308), (709.7827128933841, inf)),
        *((-745.1332191019411, 5e-324), (-745.1332191019412, 0.0)),
    ],
    "log": [
        *((0.0, -inf), (-0.0, -inf), (1.0, 0.0), (inf, inf), (-1.0, nan), (-inf, nan)),
        (5e-324, -744.4400719213812),
    ],
    "sqrt": [(0.0, 0.0), (-0.0, -0.0), (4.0, 2.0), (inf, inf), (-1.0, nan)],
    "abs": [(-0.0, 0.0), (-2.0, 2.0), (-inf, inf)],
    "floor": [
        *((0.0, 0.0), (-0.0, -0.0), (0.5, 0.0), (1 - 2**-53, 0.0), (1.0, 1.0), (2.5, 2.0)),
        *((-0.5, -1.0), (-5e-324, -1.0), (-1.5, -2.0), (-2.0, -2.0), (inf, inf), (-inf, -inf)),
        *both_signs((2.0**52, 2.0**52), (2.0**52 + 1, 2.0**52 + 1), (1e300, 1e300)),
        *((2.0**52 - 0.5, 2.0**52 - 1), (0.5 - 2.0**52, -(2.0**52))),
    ],
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_special_values(functions, name):
    x, expected = np.array([*SPECIAL[name], (nan, nan), (-nan, nan)]).T
    found = functions(name, x)
    np.testing.assert_array_equal(found, expected)
    real = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(found[real]), np.signbit(expected[real]))
    if name not in ("sqrt", "abs"):
        assert set(found[~real].view(np.uint64)) == {NAN}


@pytest.mark.parametrize(
    ("base", "exponent", "expected"),
    [
        # C99, F.9.4.4
        *((0.0, -3.0, inf), (-0.0, -3.0, -inf), (0.0, -2.0, inf), (-0.0, -2.0, inf)),
        *((-0.0, -0.5, inf), (0.0, 3.0, 0.0), (-0.0, 3.0, -0.0), (-0.0, 2.0, 0.0)),
        *((-0.0, 0.5, 0.0), (-1.0, inf, 1.0), (-1.0, -inf, 1.0), (1.0, nan, 1.0)),
        *((nan, 0.0, 1.0), (nan, -0.0, 1.0), (-2.0, 0.5, nan), (-2.0, 5e-324, nan)),
        *((0.5, -inf, inf), (-0.5, -inf, inf), (2.0, -inf, 0.0), (0.5, inf, 0.0), (-2.0, inf, inf)),
        *((-inf, -3.0, -0.0), (-inf, -2.0, 0.0), (-inf, -0.5, 0.0), (-inf, 3.0, -inf)),
        *((-inf, 2.0, inf), (-inf, 0.5, inf), (inf, -1.0, 0.0), (inf, 1.0, inf), (nan, 1.0, nan)),
        *((2.0, nan, nan), (-2.0, 3.0, -8.0), (-2.0, 2.0, 4.0), (10.0, 22.0, 1e22)),
        *((-1.0, 2.0**53 - 1, -1.0), (-1.0, 2.0**53, 1.0), (2.0, 1e300, inf), (0.5, 1e300, 0.0)),
        *((2.0, -1074.0, 5e-324), (5e-324, 1.0, 5e-324), (2.0, 1024.0, inf), (3.0, 5e-324, 1.0)),
    ],
)
def test_special_powers(functions, base, exponent, expected):
    found = functions("pow", np.array([base]), np.array([exponent]))[0]
    if math.isnan(expected):
        assert found.view(np.uint64) == NAN
    else:
        assert found == expected
        assert np.signbit(found) == np.signbit(expected)


def results(build):
    """All functions of numbers of every size and kind, as bits."""
    rng = np.random.default_rng(11)
    special = [x for pairs in SPECIAL.values() for x, _ in pairs]
    numbers = [special, rng.uniform(-2, 2, 999), rng.uniform(-700, 700, 999)]
    numbers.append(rng.integers(0, 2**64, 999, dtype=np.uint64).view(float))
    x = np.concatenate(numbers)
    found = [build(name, *([x, rng.permutation(x)] if name == "pow" else [x])) for name in NAMES]
    return np.array(found).view(np.uint64)


def assert_same_bits(functions, tmp_path, variants):
    expected = results(functions)
    for number, variant in enumerate(variants):
        folder = tmp_path / str(number)
        folder.mkdir()
        np.testing.assert_array_equal(results(Build(folder, *variant)), expected, str(variant))


def test_bits_are_those_of_one_lane_and_of_eight(functions, tmp_path):
    """Lanes neither meet nor round differently."""
    compiler = compilers()[-1]
    assert_same_bits(functions, tmp_path, [(compiler, 1, "-O0"), (compiler, 8, "-O1")])


@pytest.mark.ci("compiles the functions 17 times")
def test_bits_are_those_of_any_lanes_compiler_and_optimisation(functions, tmp_path):
    variants = itertools.product(compilers(), (1, 2, 4, 8), ("-O0", "-O2"))
    assert_same_bits(functions, tmp_path, variants)


def test_bits_are_those_of_cpp(functions, tmp_path):
    if not shutil.which("c++"):
        pytest.skip("no c++ on this machine")
    assert_same_bits(functions, tmp_path, [(["c++"], 2, "-O0", CPP)])
