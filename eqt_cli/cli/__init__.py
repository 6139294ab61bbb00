"""The command `eqt`: one file per command; heavy packages are imported inside the commands."""

from __future__ import annotations

import errno
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eqt_cli.core.errors import EqtError

INTERRUPTED = "eqt: interrupted; run the same command again"

FULL = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
"""What a full disk, or a quota, answers."""


def main() -> None:
    """Run the command line and exit; the only place where errors become exit codes."""
    from eqt_cli.core import interruptions

    with interruptions.as_exceptions(_interrupted_again):
        _run()


def _run() -> None:
    from eqt_cli.core.errors import EqtError
    from eqt_cli.core.interruptions import exit_code

    try:
        from eqt_cli.cli.app import app

        app()
    except EqtError as error:
        _tell(error)
        sys.exit(error.exit_code)
    except KeyboardInterrupt as error:
        _say(INTERRUPTED)
        sys.exit(exit_code(error))
    except OSError as error:
        if error.errno not in FULL:
            raise
        # All files are written where their names are known; what is left is stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        reason = str(error.strerror).lower()
        _say(f"eqt: standard output: cannot be written: {reason}")
        sys.exit(EqtError.exit_code)


def _tell(error: EqtError) -> None:
    """What went wrong, in words, and with --json also as the one document on stdout."""
    from eqt_cli.cli.shared.output import option, print_error

    text = error.told(option)
    _say(f"eqt:\n{text}" if "\n" in text else f"eqt: {text}")
    if "--json" in sys.argv:
        print_error(error)


_said: list[str] = []
"""What this process has said at its end, which is one thing."""


def _say(message: str) -> None:
    from eqt_cli.cli.shared.output import say

    _said.append(message)
    say(message)


def _interrupted_again() -> None:
    if not _said:
        _say(INTERRUPTED)
