"""Exported laws as C compilers see them: no warning, no header, and what their check says."""

import re
import shutil
import subprocess

import pytest
from case_tables import in_ci
from emulated_arm import emulated_arm
from exported_laws import FEW, FLAGS, IN_TURN, checked, compilers, law_of, written, zig

FAST = ("lee2010", "sliding")
M4 = "thumb-freestanding-eabihf"


FEW_IN_TURN = [
    in_ci("another law is fast", *pair, ("double", "float")[k % 2], unless=pair[0] in FAST)
    for k, pair in enumerate(FEW)
]


@pytest.mark.parametrize(("law", "group", "real"), FEW_IN_TURN)
def test_the_check_of_a_law_passes_with_every_compiler(tmp_path, law, group, real):
    found = law_of(group, law, real)
    folder = written(found, tmp_path)
    for command in compilers():
        status, said = checked(found, folder, command)
        assert status == 0, said
        assert re.fullmatch(
            rf"{law}: \d+ states pass; the largest error is \S+, where \S+ is allowed\n"
            rf"({law}: \d+ states near a singularity, such as a half turn, pass; .*\n)?",
            said,
        )


@pytest.mark.ci("every law, by two compilers and in two types")
@pytest.mark.parametrize(("law", "group", "real"), IN_TURN)
def test_the_check_of_every_law_passes(tmp_path, law, group, real):
    found = law_of(group, law, real)
    folder = written(found, tmp_path)
    for command in compilers():
        for level in ("-O0", "-O3"):
            assert checked(found, folder, [*command, level])[0] == 0


@pytest.mark.ci("every law, by the compiler of another processor")
@pytest.mark.parametrize(("law", "group", "real"), IN_TURN)
def test_every_law_compiles_for_a_cortex_m4(tmp_path, law, group, real):
    found = law_of(group, law, real)
    folder, made = written(found, tmp_path), tmp_path / "law.o"
    source = str(folder / f"{found.name}.c")

    def needed(core):
        command = [*zig("-target", M4, f"-mcpu={core}"), *FLAGS, "-O2", "-c", source]
        subprocess.run([*command, "-o", str(made)], check=True)
        done = subprocess.run(["nm", "-u", str(made)], capture_output=True, text=True, check=True)
        return {name for name in done.stdout.split() if name != "U" and "unwind" not in name}

    # Without a unit for floats, arithmetic and roots are routines of the compiler's library.
    assert {name for name in needed("cortex_m4") if not name.startswith("__aeabi_")} <= {
        {"double": "sqrt", "float": "sqrtf"}[real]
    }
    if real == "float":  # with it, no operation is left that it does not have: none on doubles
        assert needed("cortex_m4+vfp4d16sp") == set()


@pytest.mark.ci("a compiler and an emulator are started")
@pytest.mark.parametrize(("law", "group", "real"), FEW_IN_TURN)
def test_the_check_passes_on_emulated_arm(tmp_path, law, group, real):
    command, emulator = emulated_arm()
    found = law_of(group, law, real)
    status, said = checked(found, written(found, tmp_path), command, emulator)
    assert status == 0, said


def test_the_check_fails_where_a_number_of_the_law_is_changed(tmp_path):
    found = law_of("SO3", "goodarzi2013")
    folder = written(found, tmp_path)
    source = folder / "goodarzi2013.c"
    text = source.read_text(encoding="utf-8")
    changed = re.sub(r"\.ki = (\d\.\d)", r".ki = \g<1>001", text)
    assert changed != text
    source.write_text(changed, encoding="utf-8")
    status, said = checked(found, folder, compilers()[0])
    assert status == 1
    number = r"-?\d\S*"
    assert re.fullmatch(
        rf"goodarzi2013: state \d+ of \d+, t = {number} s: torque\[[0-2]\] is {number}; expected "
        rf"{number} to within {number}\n",
        said,
    )


def test_the_check_fails_where_memory_does_not_go_on(tmp_path):
    found = law_of("SO3", "goodarzi2013")
    folder = written(found, tmp_path)
    source = folder / "goodarzi2013.c"
    before, call, after = source.read_text(encoding="utf-8").rpartition("    *memory = next;\n")
    assert call
    source.write_text(before + "    (void)next;\n" + after, encoding="utf-8")
    status, said = checked(found, folder, compilers()[0])
    assert status == 1
    assert ": memory[0] is " in said


def test_a_law_has_no_include_but_its_header_and_refuses_fast_math(tmp_path):
    found = law_of("SE2", "logarithmic")
    folder = written(found, tmp_path)
    text = (folder / "logarithmic.c").read_text(encoding="utf-8")
    assert re.findall(r"#include.*", text) == ['#include "logarithmic.h"']
    assert "#include" not in (folder / "logarithmic.h").read_text(encoding="utf-8")
    command = [*compilers()[0], *FLAGS, "-ffast-math", "-c", str(folder / "logarithmic.c")]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "x.o")], capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    said = "the bounds of logarithmic.h do not hold with -ffast-math; compile this file without it"
    assert said in done.stderr


def test_the_header_is_a_header_of_cpp_too(tmp_path):
    folder = written(law_of("SO3", "goodarzi2013"), tmp_path)
    if not shutil.which("g++"):
        pytest.skip("g++ is not installed")
    flags = "-std=c++11 -pedantic -Wall -Wextra -Werror -fsyntax-only -x c++".split()
    subprocess.run(["g++", *flags, str(folder / "goodarzi2013.h")], check=True)
