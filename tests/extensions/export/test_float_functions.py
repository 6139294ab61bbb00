"""The elementary functions in float: their errors against mpmath, and special values."""

import ctypes
import itertools
import math
import re
import shutil
import subprocess

import mpmath
import numpy as np
import pytest

from eqt_cli.base.arrays import FUNCTIONS
from eqt_cli.numbers.c_headers import FLOAT_HEADER, PRELUDE, headers, needed

NAMES = [*FUNCTIONS, "pow"]
LIMITS = {
    name: float(limit)
    for name, limit in re.findall(r"eqt_(\w+) +(\d\.\d)\n", FLOAT_HEADER.read_text("utf-8"))
}
COUNT = 300
inf, nan = math.inf, math.nan

pytestmark = pytest.mark.skipif(not shutil.which("cc"), reason="no cc on this machine")


@pytest.fixture(scope="module")
def in_float(tmp_path_factory):
    """The functions on arrays."""
    folder = tmp_path_factory.mktemp("float")
    lines = [f'#include "{FLOAT_HEADER}"']
    for name in NAMES:
        second, given = (", const float *z", ", z[i]") if name == "pow" else ("", "")
        lines.append(
            f"void all_{name}(const float *x{second}, float *y, long n)\n"
            f"{{ long i; for (i = 0; i < n; i++) y[i] = eqt_{name}(x[i]{given}); }}"
        )
    (folder / "f.c").write_text("\n".join(lines) + "\n")
    flags = "-std=c99 -O1 -Wall -Wextra -Werror -pedantic -ffp-contract=off -fno-math-errno".split()
    made = [*flags, "-fPIC", "-shared", str(folder / "f.c"), "-o", str(folder / "f.so"), "-lm"]
    subprocess.run(["cc", *made], check=True)
    library = ctypes.CDLL(str(folder / "f.so"))

    def call(name, *given):
        arrays = [np.array(x, dtype=np.float32) for x in given]
        found = np.empty_like(arrays[0])
        addresses = [ctypes.c_void_p(each.ctypes.data) for each in (*arrays, found)]
        getattr(library, f"all_{name}")(*addresses, ctypes.c_long(len(found)))
        return found

    return call


def arguments(name, random):
    """Numbers of every size that a function is defined for."""
    sign = random.choice([-1.0, 1.0], COUNT)
    wide = np.exp(random.uniform(-80, 80, COUNT)) * sign
    small = np.exp(random.uniform(-60, 0, COUNT)) * sign
    usual = random.uniform(-10, 10, COUNT)
    return {
        "asin": [small, random.uniform(-1, 1, COUNT)],
        "acos": [small, random.uniform(-1, 1, COUNT)],
        "atanh": [small, random.uniform(-1, 1, COUNT)],
        "acosh": [1 + np.abs(wide), random.uniform(1, 3, COUNT)],
        "sinh": [small, 8 * usual],
        "cosh": [small, 8 * usual],
        "tanh": [small, usual],
        "exp": [small, 8 * usual],
        "log": [np.abs(wide), random.uniform(0.5, 2, COUNT)],
        "sqrt": [np.abs(wide)],
    }.get(name, [wide, usual, small])


def ulps(found, exact):
    """The error of normal results, in units in the last place."""
    size = abs(exact)
    if not 1.2e-38 < size < 3.4e38:
        return 0.0
    return float(abs(mpmath.mpf(float(found)) - exact) / float(np.spacing(np.float32(size))))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_errors_are_as_the_header_says(in_float, name):
    random, function = np.random.default_rng(1), abs if name == "abs" else getattr(mpmath, name)
    x = np.concatenate(arguments(name, random)).astype(np.float32)
    with mpmath.workprec(100):
        exact = [function(mpmath.mpf(float(each))) for each in x]
        worst = max(map(ulps, in_float(name, x), exact))
    assert worst <= LIMITS[name]
    assert worst >= LIMITS[name] / 3  # so that the header does not say too much


def test_the_error_of_pow_is_as_the_header_says(in_float):
    random = np.random.default_rng(2)
    x = np.exp(random.uniform(-20, 20, COUNT)).astype(np.float32)
    y = random.uniform(-4, 4, COUNT).astype(np.float32)
    with mpmath.workprec(100):
        exact = [mpmath.mpf(float(a)) ** mpmath.mpf(float(b)) for a, b in zip(x, y, strict=True)]
        assert max(map(ulps, in_float("pow", x, y), exact)) <= LIMITS["pow"]


SPECIAL = [0.0, -0.0, 1.0, -1.0, 2.0, -3.0, 0.5, inf, -inf, nan, 1e-45, 3e38, 200.0, -200.0]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_special_values_are_those_of_numpy(in_float, name):
    numpy = {"asin": "arcsin", "acos": "arccos", "atan": "arctan"} | {
        f"a{each}h": f"arc{each}h" for each in ("sin", "cos", "tan")
    }
    with np.errstate(all="ignore"):
        given = np.array(SPECIAL, dtype=np.float32).astype(float)
        expected = getattr(np, numpy.get(name, name))(given).astype(np.float32)
    found = in_float(name, SPECIAL)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    np.testing.assert_array_equal(
        np.signbit(found[expected == 0]), np.signbit(expected[expected == 0])
    )


def test_special_powers_are_those_of_python(in_float):
    values = [0.0, -0.0, 1.0, -1.0, 2.0, -2.0, 0.5, inf, -inf, nan, 3.0, -3.0]
    x, y = np.array(list(itertools.product(values, values))).T
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(in_float("pow", x, y), np.power(x, y), rtol=1e-6)


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("name", ["sin", "tanh", "pow", "sqrt"])
def test_what_a_function_needs_is_picked_and_nothing_else(tmp_path, real, name):
    second = ", eqt_real y" if name == "pow" else ""
    call = f"eqt_{name}(x{', y' if second else ''})"
    function = (
        f"eqt_real f(eqt_real x{second});\neqt_real f(eqt_real x{second}) {{ return {call}; }}\n"
    )
    parts = needed(PRELUDE + function, headers(real))
    source = tmp_path / "f.c"
    source.write_text(PRELUDE + parts + function)
    # An unused function that is inline is told by clang only.
    command = "clang" if shutil.which("clang") else "cc"
    flags = "-std=c99 -Wall -Wextra -Werror -pedantic -fno-math-errno -c -o".split()
    subprocess.run([command, *flags, str(tmp_path / "f.o"), str(source)], check=True)
    assert ("eqt_asin(" in parts) is False
