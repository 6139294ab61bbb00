"""C for WebAssembly, by a clang that knows it: that of the package ziglang, or of this machine."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from contextlib import suppress
from importlib.util import find_spec

from eqt_cli.base.errors import EqtError, Remedy
from eqt_cli.base.reporting import reporter
from eqt_cli.engines.compiler import digest, run, temporary_folder, user_cache

FLAGS = (
    "-std=c99 -O2 -ffp-contract=off -fno-math-errno -fno-trapping-math -w -nostdlib -msimd128 "
    "-Wl,--no-entry -Wl,-z,stack-size=1048576 -s"
).split()
"""Nothing is contracted, as in every library of eqt; nothing is imported."""


def command() -> list[str]:
    """Return the command of a compiler for WebAssembly.

    Raises
    ------
    EqtError
        If there is none.
    """
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding"]
    called = shlex.split(os.environ.get("CC", "")) or ["clang"]
    if "clang" in called[0] and shutil.which(called[0]) and shutil.which("wasm-ld"):
        return [*called, "--target=wasm32"]
    raise EqtError(
        "a live page needs a compiler for WebAssembly, and only to be written",
        Remedy(
            "run pip install '.[live]' in the checkout of eqt, a clang in a wheel; or install "
            "clang and lld"
        ),
    )


def compiled(source: str, fused: bool) -> bytes:
    """Return the module of a C source, compiled or from the cache.

    Parameters
    ----------
    fused
        Whether a b + c is rounded once where the browser can, or twice everywhere.

    Raises
    ------
    EqtError
        If there is no compiler, or it fails.
    """
    words = [*command(), *FLAGS, *(["-mrelaxed-simd"] if fused else [])]
    cache, key = user_cache(), digest("\0".join([source, *words]))
    if cache is not None and (cached := cache.find(key, ".wasm")):
        return cached
    with reporter().busy("compiling for the page"), temporary_folder() as folder:
        target = folder / "live.wasm"
        answer = run([*words, "-o", str(target), "-x", "c", "-"], source)
        if answer.returncode or not target.exists():
            said = (answer.stderr or answer.stdout).strip().splitlines()
            raise EqtError(f"{shlex.join(words[:4])} cannot compile a law", lines=said[:10])
        content = target.read_bytes()
    if cache is not None:
        with suppress(OSError):
            cache.keep(key, ".wasm", content)
    return content
