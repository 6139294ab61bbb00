"""Where a result comes from: versions, machine, commit. Nothing here affects numbers."""

import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from eqt_cli.base.version import __version__

_HASH = re.compile(rb"([0-9a-f]{40}(?:[0-9a-f]{24})?)\n")

_PATIENCE = 3.0
"""Time limit for git, s: a hostile repository can have it wait for a pipe, or read without end."""


def commit_of(folder: Path) -> str | None:
    """Return the commit checked out in the repository of a folder; None if git tells none.

    This command starts nothing that a repository names (hooks, filters, the monitor of files,
    helpers of remotes), as its system calls show; git refuses repositories of other users.
    """
    null = subprocess.DEVNULL
    # Such variables name another repository, as where a hook of git starts eqt.
    env = {name: text for name, text in os.environ.items() if not name.startswith("GIT_")}

    def rev_parse(*words: str) -> bytes:
        command = ["git", "-C", str(folder), "rev-parse", *words]
        return subprocess.check_output(command, stdin=null, stderr=null, env=env, timeout=_PATIENCE)

    with suppress(OSError, ValueError, subprocess.SubprocessError):
        match = _HASH.fullmatch(rev_parse("--verify", "HEAD"))
        name = rev_parse("--symbolic-full-name", "HEAD").decode().rstrip("\n")
        path = folder / rev_parse("--git-path", name).decode().rstrip("\n")
        # A link may lead to any file with a hash in it, and results are shared.
        links = any(folder.is_symlink() for folder in [path, *path.parents][: name.count("/") + 1])
        return match[1].decode() if match and not links else None
    return None


PACKAGES = ("numpy", "scipy", "h5py")


def versions() -> dict[str, Any]:
    """Describe this machine and its packages."""
    return {
        "eqt": __version__,
        "python": platform.python_version(),
        **{name: import_module(name).__version__ for name in PACKAGES},
        "platform": platform.platform(),
        "machine": platform.machine(),
    }


def provenance(folder: Path, tools: Mapping[str, str]) -> dict[str, Any]:
    """Describe this machine, the tools of the engine, and the session of a configuration."""
    command = os.fsencode(" ".join(["eqt", *sys.argv[1:]]))  # names of files need not be UTF-8
    return {
        **versions(),
        **tools,
        "cpu_count": os.cpu_count(),
        "command": command.decode(errors="backslashreplace"),
        "started": now(),
        "git": commit_of(folder),
    }


def now() -> str:
    """Return the current time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")
