"""What is said of C that cannot be used: where, what, and what to do."""

from os.path import normpath
from pathlib import Path

import pytest
from case_tables import from_yaml
from said import error_of, says

import eqt_cli
from eqt_cli.base import yaml_source
from eqt_cli.engines import compiler
from eqt_cli.extensions.code import guests, user_code

EVERYWHERE = "t = 0.5, pose = {"


@from_yaml
def test_what_does_not_fit(changes, options, said, written, config, told):
    written(*changes)
    assert says(told(config(**options)), said.replace("{cwd}", str(Path.cwd())))


def test_what_the_compiler_says(written, config, told):
    written(body="torque[0] = in->velocty[0];")
    assert "controllers[0]: lee.c cannot be compiled: lee.c:5:" in told(config())


def test_an_output_that_is_not_written(written, config, told):
    written(body="torque[0] = in->t; torque[2] = 0;")
    said = "controllers[0]: lee_torque in lee.c writes 2 of 3 numbers: its output 1…"
    assert says(told(config()), said)


def test_no_compiler(written, config, told, monkeypatch):
    written()
    monkeypatch.setattr(compiler, "missing", lambda: "there is none")
    assert says(
        told(config(numbers={"kR": 1.25})),
        "controllers[0].file: lee.c is C, and this machine has no C compiler…",
    )


# Code that does not come back, in a process of its own ------------------------------------------


def test_a_crash_names_function_and_input(written, config, told):
    written(body="if (in->t > 0) *(volatile real *)0 = 1;")
    said = told(config())
    assert said.startswith(f"controllers[0]: lee_torque in lee.c crashed (SIGSEGV) at {EVERYWHERE}")
    assert said.endswith("}; call it with this input in a debugger")


def test_a_function_that_does_not_return(written, config, told, monkeypatch):
    monkeypatch.setattr(guests, "SECONDS", 0.5)
    written(body="while (in->t >= 0) *(volatile real *)torque = 0;")
    said = told(config())
    where = f"controllers[0]: lee_torque in lee.c did not return within 0.5 s at {EVERYWHERE}"
    assert said.startswith(where)


CHANGES = {
    "fesetround": ("fesetround(FE_UPWARD);", "#include <fenv.h>"),
    "feenableexcept": ("feenableexcept(4);", "int feenableexcept(int);"),
    "chdir": ('if (chdir("/")) torque[0] = 1;', "#include <unistd.h>"),
    "signal": ("signal(2, SIG_IGN);", "#include <signal.h>"),
    "exit": ("exit(3);", "#include <stdlib.h>"),
    "abort": ("void (*volatile end)(void) = abort; end();", "#include <stdlib.h>"),
    "setlocale": ('other(1, "C");', 'char *other(int, const char *) __asm__("setlocale");'),
    "ldmxcsr": ('unsigned x = 40896; __asm__ volatile ("ldmxcsr %0" : : "m"(x));', ""),
    ".incbin": ("", '__asm__(".section .rodata\\n.incbin \\"lee.h\\"\\n.text");'),
}


@pytest.mark.parametrize("name", CHANGES)
def test_code_that_changes_the_process_or_reads_files_is_refused(written, config, told, name):
    body, more = CHANGES[name]
    written(body=body, more=more)
    assert f"lee.c uses {name}, which would change eqt's process" in told(config())


def test_names_of_its_own_are_its_own(written, config):
    """As in other programs: a variable, a field, a function and a text are no call."""
    own = "static double signal; static void alarm(void) { signal = 2; }"
    use = "struct { double close; } x = {1}; alarm();"
    use += 'torque[0] = torque[1] = torque[2] = signal * x.close * *"raise";'
    written(body=use, more=own)
    eqt_cli.load_experiment(config())


@pytest.mark.parametrize(
    "line",
    [
        '#embed "lee.h"',
        "#include_next <math.h>",
        "%: em\\\nbed <x>",
        "#pragma GCC system_header",
        "#define P(x) _Pragma(#x)\nP(GCC system_header)",
        '#define THERE __has_include("/etc/hosts")',
        "#define BUILT __TIME__",
    ],
)
def test_what_brings_bytes_that_are_not_kept_is_refused(written, config, told, line):
    written(body="", more=f"#if {int('Pragma' in line or 'pragma' in line)}\n{line}\n#endif")
    assert "is not possible; a result keeps the text of a law" in told(config())


def test_a_crash_of_the_start(written, config, told):
    start = "void lee_start(const lee_numbers *n, lee_memory *m, const lee_input *in)"
    written(body="", more=f"{start}\n{{ *(volatile real *)0 = 1; }}")
    where = f"controllers[0]: lee_start in lee.c crashed (SIGSEGV) at {EVERYWHERE}"
    assert told(config()).startswith(where)


# When it is called -------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["native"])
def test_only_solve_ivp_calls_code_at_any_time(engine, written, config, told):
    written()
    over = {"control": None, "solver": {"engine": engine}}
    assert says(
        told(config(over=over)), f"controllers[0]: engine {engine} compiles the law into the…"
    )


def test_memory_needs_a_period(written, config, told):
    written(("real unused;", "real ei[3];"))
    assert says(
        told(config(over={"control": None}, memory=["ei"], **{"as": None})),
        "controllers[0].memory: advances by a period at every call…",
    )


# What it includes --------------------------------------------------------------------------------


OPENED = {
    "by a macro": ('#define F "x.h"\n#include F', ["x.h"]),
    "by a digraph": ('%:include "x.h"', ["x.h"]),
    "below": ('#include "sub/y.h"', ["sub/y.h", "sub/z.h"]),
    "of another name": ('#line 1 "/usr/include/math.h"\n#include "x.h"', ["x.h"]),
    "as if of the system": ('# 1 "/usr/include/math.h" 1 3\n#include "x.h"', ["x.h"]),
    "hidden by _Pragma": ('_Pragma("GCC system\\x5fheader")\n#include "x.h"', ["x.h"]),
    "compiled before": ('#include "old.h"', ["old.h"]),
    "linked": ('#include "link.h"', ["link.h"]),  # with the text that is there
    "outside": ('#include "../far.h"', None),
    "outside, by a macro": ('#define F "../far.h"\n#include F', None),
    "by its path": ('#include "{here}/../far.h"', None),
}


@pytest.mark.parametrize("name", OPENED)
def test_all_that_the_compiler_opens_is_kept_or_refused(tmp_path, name):
    """The compiler's own list (-M) says what it opened, but for the system's headers."""
    (here := tmp_path / "here" / "sub").mkdir(parents=True)
    line, expected = OPENED[name]
    law = here.parent / "lee.c"
    law.write_text(line.replace("{here}", str(law.parent)) + "\ndouble a = FAR;\n")
    (tmp_path / "far.h").write_text("#define FAR 1\n")
    (law.parent / "link.h").symlink_to(tmp_path / "far.h")
    (law.parent / "old.h.gch").write_bytes(b"nothing that was compiled")
    (here / "y.h").write_text('#include "z.h"\n')
    for each in (law.parent / "x.h", law.parent / "old.h", here / "z.h"):
        each.write_text("#define FAR 2\n")
    listed = compiler.run([*compiler.compiler().command, "-w", "-M", str(law)]).stdout
    opened = {Path(normpath(each)) for each in listed.replace("\\\n", " ").split()[1:]}
    ours = {path for path in opened if path.is_relative_to(tmp_path)}
    if expected is None:
        assert tmp_path / "far.h" in ours
        assert error_of(user_code.gathered, law).endswith(
            "far.h, which is not in its folder; a result keeps only files in this folder and "
            "below; copy the file there"
        )
        return
    kept = user_code.files_in(user_code.gathered(law), "lee.c")
    assert ours == {law.parent / file for file in kept}
    assert list(kept) == ["lee.c", *expected]


@pytest.mark.parametrize("option", ["-I", "-isystem", "-include"])
def test_a_compiler_that_brings_headers_is_refused(monkeypatch, tmp_path, option):
    (tmp_path / "far.h").touch()
    monkeypatch.setenv("CC", f"cc {option} {tmp_path / 'far.h' if 'clude' in option else tmp_path}")
    assert f"reads headers that no result names; remove {option} from" in error_of(
        compiler.compiler
    )


@pytest.mark.parametrize("name", ["CPATH", "C_INCLUDE_PATH"])
def test_a_header_that_only_the_environment_leads_to_is_not_found(
    written, config, told, monkeypatch, tmp_path_factory, name
):
    """A result could not name it; what C_INCLUDE_PATH leads to even counts as the system's."""
    far = tmp_path_factory.mktemp("far")
    (far / "far.h").write_text("#define FAR 1\n", encoding="utf-8")
    monkeypatch.setenv(name, str(far))
    written(body="torque[0] = FAR;", more="#include <far.h>")
    said = told(config())
    assert "lee.c cannot be compiled: lee.c:" in said and "far.h" in said


def test_a_header_that_includes_itself(written, config, told):
    written()
    Path("lee.h").write_text('#include "lee.h"\n', encoding="utf-8")
    said = told(config())
    assert said.startswith("controllers[0].file: lee.c cannot be compiled: lee.h:1:")
    assert said.endswith("; compile it with your own compiler to see all of it")


def test_headers_without_end_are_bounded(written, config, told):
    """Each includes the next one three times, 18 deep."""
    written(body="", more='#include "h0.h"')
    for k in range(18):
        Path(f"h{k}.h").write_text(f'#include "h{k + 1}.h"\n' * 3, encoding="utf-8")
    Path("h18.h").touch()
    assert "lee.c cannot be compiled: " in told(config())


def test_a_device_that_never_ends_is_bounded(written, config, told):
    written(body="", more='#include "/dev/zero"')
    assert "lee.c cannot be compiled: " in told(config())


def test_a_header_of_the_current_folder_is_foreign(written, config, told, monkeypatch, tmp_path):
    written(body="", more='#include "gain.h"')
    Path("c.yaml").write_text(yaml_source.dump(config()), encoding="utf-8")
    (tmp_path / "foreign").mkdir()
    monkeypatch.chdir("foreign")
    Path("gain.h").touch()
    said = told("../c.yaml")
    assert "controllers[0].file: lee.c cannot be compiled: lee.c:2:" in said and "gain.h" in said


def test_of_a_file_of_another_system_nothing_is_known_without_nm(monkeypatch):
    monkeypatch.setattr(user_code.shutil, "which", lambda name: None)
    assert user_code.static_state(b"\xcf\xfa\xed\xfe") is None


def test_code_that_claims_no_law_needs_no_gains(written, config):
    written()
    alone = config(**{"as": None})
    alone.pop("gains")
    eqt_cli.load_experiment(alone)
    lee = config()
    lee.pop("gains")
    assert "gains: missing" in error_of(eqt_cli.load_experiment, lee)
