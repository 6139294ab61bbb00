"""The command `eqt`: one file per command; heavy packages are imported inside the commands."""

import atexit
import errno
import gc
import os
import sys
import warnings
from typing import Any

from eqt_cli.base import process
from eqt_cli.base.errors import EqtError, InterruptedRun
from eqt_cli.base.process import without_current_folder
from eqt_cli.base.reporting import reporting

# pydantic otherwise reads the metadata of every installed package, in search of plugins.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

# Matrices are small here: a BLAS in threads took up to 90 % more CPU time, and no less wall time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

INTERRUPTED = "interrupted; run the same command again"

OBJECTS_BETWEEN_COLLECTIONS = 400_000
"""New objects between searches for unreachable ones, instead of Python's 700 or 2,000: loading
libraries makes many objects and no garbage. Of shipped configurations a run makes 195,000 to
300,000; a search among them takes 60 to 80 ms and finds 1 %."""


def main() -> None:
    """Run the command line and exit; the only place where errors become exit codes."""
    process.make_safe()
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    # Else Python searches all objects once more at the end of the process, for 0.1 to 0.4 s.
    atexit.register(gc.freeze)
    warning_state = warnings.catch_warnings()
    requests = process.as_exceptions(_interrupted_again)
    with requests as stop, without_current_folder(), warning_state:
        warnings.showwarning = _show
        _run(stop)


def _show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
    """Print a library's warning, without the line of code that warned."""
    from eqt_cli.cli.output import say

    if category is not RuntimeWarning:  # of NumPy: the numbers themselves tell the same
        say(f"{category.__name__}: {message}")


def _app(stop: process.Requests) -> None:
    try:
        from eqt_cli.cli.output import be_quiet, meter

        be_quiet(False)
        from eqt_cli.cli.app import app

        with reporting(meter()):
            app()
    except (Exception, SystemExit) as error:
        if isinstance(error, SystemExit) and not _is_of_plugin(error):
            raise
        # Python and HDF5 may make an error of their own of an interruption.
        if stop.number is None or isinstance(error, InterruptedRun):
            from eqt_cli.base.registry import blamed

            if not isinstance(error, EqtError) and (old := process.too_old("eqt-cli")):
                raise EqtError(old) from error
            with blamed():  # a command of another distribution may fail
                raise
        raise process.Interrupted(stop.number) from error
    finally:
        sys.stdout.flush()


def _is_of_plugin(end: SystemExit) -> bool:
    """Whether a plugin, and not a command, ends eqt."""
    registry = sys.modules.get("eqt_cli.base.registry")
    return registry is not None and registry.place_of(end, registry.is_plugin) is not None


def _run(stop: process.Requests) -> None:
    try:
        _app(stop)
    except (EqtError, process.Interrupted) as error:
        if isinstance(error, process.Interrupted):  # what is kept is not known here
            error = InterruptedRun(INTERRUPTED, error.exit_code)
        _tell(error)
        sys.exit(error.exit_code)
    except MemoryError:
        _tell(EqtError("not enough memory; use fewer workers, or a smaller part of the experiment"))
        sys.exit(EqtError.exit_code)
    except OSError as error:
        from eqt_cli.base.files import NO_SPACE

        refused = None
        if error.errno in (errno.EMFILE, errno.ENFILE):
            refused = "too many open files; use fewer workers, or raise the limit by `ulimit -n`"
        elif error.filename is not None:  # a name given by the user, such as one too long
            refused = f"{error.filename}: cannot be used: {str(error.strerror).lower()}"
        elif not process.has_current_folder():
            refused = "the current folder does not exist any more; change to another one"
        if refused:
            _tell(EqtError(refused))
            sys.exit(EqtError.exit_code)
        if error.errno not in NO_SPACE:
            raise
        # Errors in writing files are handled where their names are known; only stdout is left.
        process.drop_stdout()
        reason = str(error.strerror).lower()
        _say(f"standard output: cannot be written: {reason}", "error")
        sys.exit(EqtError.exit_code)


def _tell(error: EqtError) -> None:
    """Print an error in words, and with --json also as the one document on stdout."""
    from eqt_cli.base.errors import ConfigError
    from eqt_cli.cli.output import option, print_error

    text = error.with_advice(option)
    if isinstance(error, InterruptedRun):
        _say(f"eqt: {text}")
    else:
        _say(text, "error", error.heading if isinstance(error, ConfigError) else "")
    if "--json" in sys.argv:
        print_error(error)


_said: list[str] = []
"""Final messages of this process, of which there is at most one."""


def _say(message: str, label: str = "", heading: str = "") -> None:
    from eqt_cli.cli.output import complain

    _said.append(message)
    complain(message, label, heading)


def _interrupted_again() -> None:
    if not _said:
        _say(f"eqt: {INTERRUPTED}")
