"""Which C compiler the engine native calls, what it says where it cannot, and what it keeps."""

import ctypes
import errno
import os
import select
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from case_tables import refusal
from said import says

from eqt_cli.engines import compiler
from eqt_cli.extend import EqtError

LANES = {(): 2, ("AVX",): 4, ("AVX", "AVX-512"): 8}
SOURCE = "double f(double x) { return x + 1.0; }"
ZIG = (sys.executable, "-m", "ziglang", "cc")
CHOOSE = "set the variable CC to a C compiler, or remove it"


@pytest.fixture(autouse=True)
def fresh(tmp_path, monkeypatch):
    """Nothing is known of compilers, nothing is cached, and CC says nothing."""
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(compiler, "WINDOWS", False)
    forget()
    yield
    forget()


def forget():
    """As in another process."""
    compiler._first.cache_clear()
    compiler._library.cache_clear()


@pytest.fixture(autouse=True)
def _as_users_compile(monkeypatch):
    """With optimisation, which other tests leave out."""
    monkeypatch.setattr(compiler, "LIBRARY", (*compiler.FLAGS, "-w", "-shared", "-fPIC"))


@pytest.fixture
def on_path(tmp_path, monkeypatch):
    """A PATH with nothing but these programs, which are scripts."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))

    def put(name, script="exit 1"):
        path = folder / name
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        return (str(path),)

    return put


@pytest.fixture
def without_zig(monkeypatch):
    monkeypatch.setattr(compiler, "find_spec", lambda name: None)


@pytest.fixture
def with_zig(monkeypatch):
    monkeypatch.setattr(compiler, "find_spec", lambda name: name == "ziglang")


@pytest.fixture
def cc(monkeypatch):
    """A compiler that counts how often it is called: as ``calls()``."""
    found = shutil.which("cc") or pytest.skip("needs a C compiler (cc)")
    calls = []
    run = compiler.run

    def counted(command, *rest):
        calls.append("-dM" not in command)
        return run(command, *rest)

    monkeypatch.setattr(compiler, "run", counted)
    monkeypatch.setenv("CC", found)
    return lambda: (calls.count(True), calls.count(False))


def kept():
    return sorted((compiler.user_cache() or pytest.fail("no cache")).folder.glob("*.so"))


def works():
    f = compiler.library(SOURCE).f
    f.restype, f.argtypes = ctypes.c_double, [ctypes.c_double]
    return f(1.0) == 2.0


# Which ------------------------------------------------------------------------------------------


def test_cc_comes_before_clang_and_gcc_and_the_package_last(on_path, with_zig):
    gcc, clang, first = on_path("gcc"), on_path("clang"), on_path("cc")
    assert compiler.commands() == [first, clang, gcc, ZIG]


def test_on_windows_the_package_comes_first(on_path, with_zig, monkeypatch):
    monkeypatch.setattr(compiler, "WINDOWS", True)
    found = on_path("gcc")
    assert compiler.commands() == [ZIG, found]


def test_the_variable_cc_rules_with_its_arguments(on_path, with_zig, monkeypatch):
    on_path("cc")
    monkeypatch.setenv("CC", "ccache 'my gcc' -m64")
    assert compiler.commands() == [("ccache", "my gcc", "-m64")]


def test_a_blank_variable_cc_says_nothing(on_path, without_zig, monkeypatch):
    monkeypatch.setenv("CC", " ")
    found = on_path("cc")
    assert compiler.commands() == [found]


def test_without_a_compiler_a_message_says_how_to_get_one(on_path, without_zig, monkeypatch):
    monkeypatch.setattr(compiler.platform, "system", lambda: "Linux")
    monkeypatch.setattr(compiler.platform, "machine", lambda: "x86_64")
    expected = (
        "engine native needs a C compiler: install gcc or clang, or 'pip install ziglang' (extra "
        "native), a clang in a wheel (this is Linux on x86_64); or use engine solve_ivp"
    )
    assert compiler.missing() == expected
    assert refusal(EqtError, compiler.library, SOURCE) == expected


def test_a_compiler_that_does_not_work_gives_way_to_the_next(on_path, without_zig):
    on_path("cc", "echo 'error: no developer tools were found' >&2; exit 1")
    gcc = on_path("gcc", 'echo "#define __GNUC__ 12"; echo "#define __VERSION__ \\"12.2.0\\""')
    found = compiler.compiler()
    assert (found.command, found.version) == (gcc, "gcc 12.2.0")


def test_a_compiler_that_does_not_know_this_machine_compiles_for_any_like_it(on_path, without_zig):
    script = 'case "$*" in *native*) exit 1;; esac; echo "#define __clang__ 1"'
    on_path("cc", script)
    assert compiler.compiler().flags == ()


def test_a_result_can_tell_version_flags_and_processor(on_path, without_zig):
    said = ("__clang__ 1", '__clang_version__ "19.1.0 "', "__AVX2__ 1", "__FMA__ 1")
    (path,) = on_path("cc", "".join(f"echo '#define {each}'\n" for each in said))
    assert compiler.compiler().described == (
        f"clang 19.1.0: {path} -std=c99 -O2 -ffp-contract=off -fno-math-errno -fno-trapping-math "
        "-w -shared -fPIC -march=native; AVX2, FMA"
    )


def test_an_unknown_compiler_is_known_by_its_version(on_path, without_zig):
    on_path("cc", "echo '#define __VERSION__ \"9.1 beta\"'")
    assert compiler.compiler().version == "C compiler 9.1"


def test_different_sources_are_compiled_side_by_side(cc, monkeypatch):
    both, compiled = threading.Barrier(2, timeout=10), compiler._compiled

    def met(*given):
        both.wait()  # in turn, the first would wait in vain
        return compiled(*given)

    monkeypatch.setattr(compiler, "_compiled", met)
    sources = [SOURCE, SOURCE.replace("1.0", "2.0")]
    with ThreadPoolExecutor(4) as pool:
        libraries = [*pool.map(compiler.library, [*sources, *sources])]
    assert libraries[:2] == libraries[2:]
    assert not both.broken


def test_on_windows_a_command_may_have_backslashes_and_quotes(monkeypatch):
    monkeypatch.setattr(compiler, "WINDOWS", True)
    monkeypatch.setenv("CC", '"C:\\Program Files\\cc.exe" -m64')
    assert compiler.commands() == [("C:\\Program Files\\cc.exe", "-m64")]


def test_a_compiler_that_is_named_is_not_missing(on_path, without_zig, monkeypatch):
    monkeypatch.setenv("CC", "mine")
    assert compiler.missing() is None


def test_the_files_of_a_compiler_are_its_program_and_those_of_the_package(
    on_path, tmp_path, monkeypatch
):
    (program,) = on_path("python")
    package = tmp_path / "ziglang"
    package.mkdir()
    for name in ("zig", "zig.h", "lib"):
        (package / name).touch()
    spec = SimpleNamespace(origin=str(package / "__init__.py"))
    monkeypatch.setattr(compiler, "find_spec", lambda name: spec)
    found = list(compiler._files(("python", "-m", "ziglang", "cc")))
    assert found == [Path(program).resolve(), package / "zig", package / "zig.h"]
    assert list(compiler._files(("python", "-m", "cc"))) == [Path(program).resolve()]


CPUINFO = """\
processor\t: 0
model name\t: one with a name that is somewhat longer than others
cpu MHz\t\t: 2400.1
flags\t\t: avx fma

processor\t: 1
model name\t: another
"""


def test_a_processor_is_the_first_one_without_what_varies(monkeypatch, tmp_path):
    told = tmp_path / "cpuinfo"
    told.write_text(CPUINFO)
    monkeypatch.setattr(compiler, "Path", lambda name: told)
    assert compiler._processor() == [CPUINFO.splitlines()[1], CPUINFO.splitlines()[3]]
    told.unlink()
    assert compiler._processor() == []


# What it says where it cannot ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("called", "message"),
    [
        ("nowhere-cc", "the C compiler nowhere-cc cannot be started: No such file or directory"),
        ("false", "the C compiler false does not work"),
        ("'gcc", "the variable CC is not a command: 'gcc: no closing quotation"),
    ],
)
def test_a_variable_cc_that_will_not_do_is_refused(called, message, monkeypatch):
    monkeypatch.setenv("CC", called)
    assert refusal(EqtError, compiler.compiler) == f"{message}; {CHOOSE}"


def test_what_a_compiler_complains_of_is_told_in_lines(on_path, without_zig):
    (path,) = on_path("cc", "echo one >&2; echo 'x: error: bad option' >&2; echo two >&2; exit 1")
    assert refusal(EqtError, compiler.compiler).splitlines() == [
        f"the C compiler {path} does not work",
        "x: error: bad option",
        CHOOSE,
    ]


@pytest.mark.parametrize(
    ("script", "lines"),
    [
        ("echo 'error: told in the wrong place'; exit 1", ["error: told in the wrong place"]),
        ("echo '#define __GNUC__ 12'; echo 'error: half' >&2; exit 1", ["error: half"]),
        ("echo 'nothing known'", ["nothing known"]),
    ],
)
def test_a_compiler_that_fails_or_tells_nothing_is_refused(on_path, without_zig, script, lines):
    (path,) = on_path("cc", script)
    first, *told, last = refusal(EqtError, compiler.compiler).splitlines()
    assert (first, told, last) == (f"the C compiler {path} does not work", lines, CHOOSE)


def test_five_lines_are_told_the_first_with_errors_or_else_the_last():
    lines = [f"line {k}" for k in range(9)]
    assert compiler.error_lines("\n".join(lines)) == lines[4:]
    errors = [f"error {k}" for k in range(9)]
    assert compiler.error_lines("\n".join([*lines, *errors])) == errors[:5]


@pytest.mark.parametrize("made", [True, False])
def test_what_a_compiler_makes_counts_only_where_it_succeeds(on_path, without_zig, made):
    """One fails behind its file, the other makes none."""
    ending = "echo half > $2; exit 1" if made else "exit 0"
    script = f"""case "$*" in *-dM*) echo '#define __GNUC__ 12'; exit;; esac
        while [ "$1" != -o ]; do shift; done; {ending}"""
    (path,) = on_path("cc", script)
    with pytest.raises(EqtError, match=f"the C compiler {path} cannot compile a law"):
        compiler.library(SOURCE)


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("-ffast-math", "does not round as IEEE 754 says (__FAST_MATH__ is 1)"),
        ("-fsingle-precision-constant", "reads 0.1 as a float"),
    ],
)
def test_a_compiler_that_computes_otherwise_is_refused(cc, monkeypatch, option, said):
    called = f"{os.environ['CC']} {option}"
    monkeypatch.setenv("CC", called)
    expected = f"the C compiler {called} {said}; remove …{option} from the variable CC"
    assert says(refusal(EqtError, compiler.compiler), expected)


def test_a_source_that_does_not_compile_is_told_in_short(cc):
    first, error, *_, last = refusal(
        EqtError, compiler.library, "int f(void) { return nothing; }"
    ).splitlines()
    assert first == f"the C compiler {os.environ['CC']} cannot compile a law"
    assert "nothing" in error
    assert last == "set the variable CC to another C compiler, or use engine solve_ivp"


def test_what_cannot_be_loaded_is_told(on_path, without_zig, monkeypatch):
    script = """case "$*" in *-dM*) echo '#define __GNUC__ 12'; exit;; esac
        while [ "$1" != -o ]; do shift; done; echo nothing > "$2" """
    (path,) = on_path("cc", script)
    first, _, last = refusal(EqtError, compiler.library, SOURCE).splitlines()
    assert first == f"what the C compiler {path} makes cannot be loaded"
    assert last == "set the variable CC to a compiler for this machine, or use engine solve_ivp"


def test_a_compiler_that_hangs_is_ended_with_what_it_started(on_path, without_zig, monkeypatch):
    monkeypatch.setattr(compiler, "SECONDS", 0.2)
    # The pipe stays open as long as the inner one lives.
    (path,) = on_path("cc", "/bin/sh -c '/bin/sleep 60'; exit 1")
    assert refusal(EqtError, compiler.compiler) == (
        f"the C compiler {path} did not end within 0.2 s: {path} -march=native -dM -E -x c -; "
        "set the variable CC to another C compiler, or use engine solve_ivp"
    )


def test_what_a_compiler_leaves_behind_is_ended_too(on_path, without_zig, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    on_path("cc", f"/bin/sh -c 'exec 3>{pipe}; exec /bin/sleep 20' & exit 1")
    with pytest.raises(EqtError, match="does not work"):
        compiler.compiler()
    for _ in range(100):
        try:
            assert os.read(reading, 1) == b""  # nobody can write to it any more
            break
        except BlockingIOError:
            threading.Event().wait(0.02)
    else:
        pytest.fail("a process that the compiler has started lives")
    os.close(reading)


LIMITS = "import os, resource as r; print([r.getrlimit(k)[0] for k in (r.RLIMIT_CPU, r.RLIMIT_AS, "
LIMITS += "r.RLIMIT_FSIZE)], os.listdir())"


@pytest.mark.skipif(sys.platform != "linux", reason="macOS has no limit of the address space")
def test_a_program_has_limits_and_an_empty_folder():
    found = compiler.run_contained(
        [sys.executable, "-c", LIMITS], b"", compiler.Limits(7.0, 2**31, 2**20)
    )
    assert found.stdout.decode() == f"{[7, 2**31, 2**20]} []\n"


def test_what_cannot_be_written_is_no_fault_of_the_compiler(on_path):
    on_path("cc", "echo 'No space left on device' >&2; exit 1")
    with pytest.raises(EqtError) as caught:
        compiler.run(["cc"])
    assert str(caught.value.with_advice(str)) == (
        f"a law cannot be compiled: a temporary file in {tempfile.gettempdir()} cannot be written: "
        "no space left on device; free some space there, raise the largest file size "
        "(`ulimit -f`), or set the variable TMPDIR to another folder"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere, its limit of time ends it")
def test_a_program_ends_with_eqt_and_so_does_what_it_has_started(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    script = f"exec 3>{pipe}; echo began >&3; sleep 30 & sleep 30"
    code = "from eqt_cli.engines.compiler import *; "
    code += f"run_contained(['/bin/sh', '-c', {script!r}], b'', Limits(60.0))"
    eqt = subprocess.Popen([sys.executable, "-c", code])
    assert select.select([reading], [], [], 30)[0] and os.read(reading, 100) == b"began\n"
    eqt.kill()
    eqt.wait()
    assert select.select([reading], [], [], 10)[0] and os.read(reading, 1) == b""
    os.close(reading)


def test_without_a_folder_for_temporary_files_it_says_so(cc, monkeypatch):
    compiler.compiler()
    monkeypatch.setattr(compiler.tempfile, "tempdir", "the place for temporary files")
    assert says(
        refusal(EqtError, compiler.library, SOURCE),
        "a law cannot be compiled: there is…: No such file or directory…",
    )


# What it keeps ------------------------------------------------------------------------------------


def test_another_process_finds_what_was_compiled_and_who_compiled_it(cc, told):
    """And tells nothing of compiling."""
    assert works() and cc() == (1, 1)
    forget()
    assert works() and cc() == (1, 1)
    assert told.activities == ["compiling the laws"]


def test_what_runs_little_is_compiled_quickly_unless_there_is_better_code(cc):
    compiler.library(SOURCE, quick=True)
    [quick] = kept()
    forget()
    compiler.library(SOURCE, quick=True)
    assert cc() == (1, 1)
    assert works() and cc() == (2, 1) and len(kept()) == 2
    quick.unlink()
    forget()
    compiler.library(SOURCE, quick=True)
    assert cc() == (2, 1)


def test_the_folder_is_the_users_alone(cc, tmp_path):
    (tmp_path / "cache").mkdir(mode=0o755)
    old = os.umask(0o002)
    try:
        works()
    finally:
        os.umask(old)
    folder = tmp_path / "cache" / "eqt" / "native"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert kept()[0].parent == folder


@pytest.mark.parametrize("damage", ["truncated", "changed", "empty"])
def test_a_damaged_file_is_not_loaded_but_built_anew(cc, damage):
    works()
    (path,) = kept()
    whole = path.read_bytes()
    changed = bytearray(whole)
    changed[len(changed) // 2] ^= 1
    damaged = {"truncated": whole[: len(whole) // 2], "changed": bytes(changed), "empty": b""}
    path.unlink()  # this process has it in memory
    path.write_bytes(damaged[damage])
    forget()
    assert works() and cc() == (2, 1)
    assert [each.read_bytes() for each in kept()] == [whole]


def test_a_damaged_record_of_a_compiler_is_asked_for_anew(cc):
    found = compiler.compiler()
    folder = compiler.user_cache().folder
    (record,) = folder.glob("*.json")
    record.write_text("{")
    forget()
    assert compiler.compiler() == found and cc() == (0, 2)


def test_another_compiler_in_its_place_is_asked(cc, tmp_path, monkeypatch):
    mine = tmp_path / "mine"
    mine.write_text(f'#!/bin/sh\nexec {shlex.quote(os.environ["CC"])} "$@"\n')
    mine.chmod(0o755)
    monkeypatch.setenv("CC", str(mine))
    compiler.compiler()
    mine.write_text(mine.read_text() + "# newer\n")
    forget()
    compiler.compiler()
    assert cc() == (0, 2)


@pytest.mark.parametrize("processors", [[[], []], [["flags: avx"], ["flags: fma"]]])
def test_of_an_unknown_or_another_processor_a_compiler_is_asked_again(cc, monkeypatch, processors):
    for processor in processors:
        monkeypatch.setattr(compiler, "_processor", lambda processor=processor: processor)
        forget()
        compiler.compiler()
    assert cc() == (0, 2)


def blocked_by_a_file(folder):
    folder.parent.mkdir(parents=True)
    folder.write_text("")


def others_can_write(folder):
    folder.mkdir(parents=True)
    folder.chmod(0o770)


def in_a_folder_of_all(folder):
    folder.parent.parent.mkdir()
    folder.parent.parent.chmod(0o777)


def a_link(folder):
    elsewhere = folder.parent / "elsewhere"
    elsewhere.mkdir(parents=True)
    folder.symlink_to(elsewhere)


@pytest.mark.parametrize("put", [blocked_by_a_file, others_can_write, a_link, in_a_folder_of_all])
def test_a_folder_that_is_not_the_users_alone_is_not_used(cc, put, tmp_path, told):
    folder = tmp_path / "cache" / "eqt" / "native"
    put(folder)
    compiler._tell.cache_clear()
    assert compiler.user_cache() is None
    assert works() and cc() == (1, 1)
    assert not folder.is_dir() or not list(folder.iterdir())
    remark = (
        f"compiled laws are not kept: other users can replace the files in {tmp_path / 'cache'}; "
        "remove their permission to write to it, or set XDG_CACHE_HOME to another one"
    )
    assert [str(each) for each in told.remarks] == [remark] * (put is in_a_folder_of_all)


def test_a_folder_of_all_in_which_each_has_his_own_is_safe(cc, tmp_path):
    """As /tmp, by its sticky bit."""
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o1777)
    assert works() and len(kept()) == 1


@pytest.mark.parametrize("entry", ["pipe", "link", "of others"])
def test_only_own_regular_files_are_loaded(cc, entry, tmp_path):
    """Neither does it wait for the pipe, nor read what a link leads to."""
    works()
    (path,) = kept()
    if entry == "of others":
        path.chmod(0o666)
    else:
        path.rename(tmp_path / path.name)
        os.mkfifo(path) if entry == "pipe" else path.symlink_to(tmp_path / path.name)
    forget()
    assert works() and cc() == (2, 1)
    assert kept()[0].is_file() and not kept()[0].is_symlink()


def test_what_was_checked_is_what_is_loaded(cc, monkeypatch):
    """Whatever becomes of the file after it was read."""
    works()
    forget()
    find = compiler.Cache.find

    def changed(self, *key):
        found = find(self, *key)
        for path in self.folder.glob(f"*{key[1]}"):
            path.write_bytes(b"something else")
        return found

    monkeypatch.setattr(compiler.Cache, "find", changed)
    assert works() and cc() == (1, 1)


def test_folders_above_may_be_those_of_the_system(monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    found = [SimpleNamespace(st_uid=uid, st_mode=0o40755) for uid in (0, 1000, 1)]
    assert [*map(compiler._is_safe, found)] == [True, True, False]


def test_a_folder_of_another_user_is_not_used(cc, monkeypatch):
    compiler.user_cache()
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert compiler.user_cache() is None


def test_without_a_home_nothing_is_kept(cc, monkeypatch):
    def none():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", none)
    assert compiler.user_cache() is None
    assert works()


def test_a_relative_folder_for_caches_is_not_used(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", "here")
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "home")
    assert compiler.user_cache().folder == tmp_path / "home" / ".cache" / "eqt" / "native"


@pytest.mark.parametrize("chosen", [True, False])
def test_on_windows_the_cache_is_among_the_users_local_data(monkeypatch, tmp_path, chosen):
    folder = tmp_path / ("chosen" if chosen else "home/AppData/Local")
    environment = {"LOCALAPPDATA": str(folder)} if chosen else {}
    monkeypatch.setattr(compiler, "os", SimpleNamespace(name="nt", environ=environment))
    monkeypatch.setattr(compiler.Path, "home", lambda: tmp_path / "home")
    assert compiler.user_cache().folder == folder / "eqt" / "native"
    assert (folder / "eqt" / "native").is_dir()


def test_a_full_disk_keeps_nothing_and_stops_nothing(cc, monkeypatch):
    def full(path, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(compiler, "replace_file", full)
    assert works()
    assert kept() == []


def test_the_files_that_were_not_used_for_longest_go(monkeypatch):
    monkeypatch.setattr(compiler, "MOST_FILES", 3)
    own = compiler.user_cache()
    unfinished = own.folder / f"x.so.{'0' * 16}.tmp"
    unfinished.touch()
    os.utime(unfinished, (0, 0))
    for age in range(3):
        own.keep(compiler.digest(f"{age}"), ".so", b"%d" % age)
        (path,) = own.folder.glob(f"{compiler.digest(f'{age}')[:32]}-*")
        os.utime(path, (100 + age, 100 + age))
    own.find(compiler.digest("0"), ".so")
    own.keep(compiler.digest("3"), ".so", b"3")
    found = [own.find(compiler.digest(f"{age}"), ".so") for age in range(4)]
    assert found == [b"0", None, b"2", b"3"]
    assert len(list(own.folder.iterdir())) == 3


@pytest.mark.ci("starts two processes")
def test_two_processes_that_compile_the_same_both_have_it(cc, tmp_path):
    """Each replaces the file of the other by an equal one while it may be loaded."""
    done = []

    def another():
        code = f"from eqt_cli.engines.native import compiler; compiler.library({SOURCE!r})"
        done.append(subprocess.run([sys.executable, "-c", code], check=False).returncode)

    processes = [threading.Thread(target=another) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert done == [0, 0]
    assert kept()
    forget()
    assert works() and cc() == (0, 0)


@pytest.mark.parametrize("features", LANES)
def test_lanes_fill_a_vector_of_the_processor(features):
    found = compiler.Compiler(("cc",), (), "cc 1", features, "")
    assert found.lanes == LANES[features]


def test_a_compiler_that_says_nothing_had_no_room(monkeypatch):
    """As gcc where the folder of its temporary files is full: it cannot keep its own message."""
    usage = shutil.disk_usage("/")
    monkeypatch.setenv("TMPDIR", "/full")
    for free, expected in ((2**10, errno.ENOSPC), (2**30, None)):
        monkeypatch.setattr("shutil.disk_usage", lambda path, free=free: usage._replace(free=free))
        assert compiler.no_space(b"", compiler.Limits(1.0)) == expected


def test_without_proc_native_says_so_and_eqt_takes_the_other_engine(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(compiler, "_OWN_FILES", Path("/no/proc"))
    assert says(compiler.missing(), "engine native…/no/proc…mount /proc, or use engine solve_ivp")
