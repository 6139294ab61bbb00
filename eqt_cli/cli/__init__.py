"""The command `eqt`: one file per command; heavy packages are imported inside the commands."""

from __future__ import annotations

import errno
import os
import sys

FULL = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
"""What a full disk, or a quota, answers."""


def main() -> None:
    """Run the command line and exit; the only place where errors become exit codes."""
    from eqt_cli.cli.app import app
    from eqt_cli.cli.shared.output import option, print_error, say
    from eqt_cli.core.errors import EqtError

    try:
        app()
    except EqtError as error:
        text = error.told(option)
        say(f"eqt:\n{text}" if "\n" in text else f"eqt: {text}")
        if "--json" in sys.argv:  # stdout is then one document, whatever happens
            print_error(error)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        say("eqt: interrupted; run the same command again")
        sys.exit(130)
    except OSError as error:
        if error.errno not in FULL:
            raise
        # All files are written where their names are known; what is left is stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        reason = str(error.strerror).lower()
        say(f"eqt: standard output: cannot be written: {reason}")
        sys.exit(EqtError.exit_code)
