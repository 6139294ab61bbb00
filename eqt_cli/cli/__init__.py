"""The command `eqt`: one file per command; heavy packages are imported inside the commands."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line and exit; the only place where errors become exit codes."""
    from eqt_cli.cli.app import app
    from eqt_cli.core.errors import EqtError

    try:
        app()
    except EqtError as error:
        print(f"eqt: {error}" if "\n" not in str(error) else f"eqt:\n{error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("eqt: interrupted; run the same command again", file=sys.stderr)
        sys.exit(130)
