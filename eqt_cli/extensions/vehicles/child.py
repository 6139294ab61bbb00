"""The process in which xacro and MuJoCo read a file; `contained` starts it and hears its answer."""

from __future__ import annotations

import json
import math
import os
import sys
from contextlib import redirect_stdout, suppress
from dataclasses import asdict
from pathlib import Path
from time import process_time
from typing import Any

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.contained import LACKS_MEMORY, MEMORY, SECONDS, TITLES
from eqt_cli.extensions.vehicles.elements import shown
from eqt_cli.extensions.vehicles.request import Request


def main() -> None:
    """Read the request from stdin, and write the answer to stdout."""
    out, kind = os.fdopen(os.dup(1), "wb"), sys.argv[2]
    entries = json.load(sys.stdin)
    entries |= {"path": Path(entries["path"]), "models": [Path(name) for name in entries["models"]]}
    request = Request(**entries)
    os.environ.clear()
    os.environ.update({name: value for name, value in request.arguments.items() if name})
    said: dict[str, Any] = {}
    try:
        with redirect_stdout(sys.stderr):
            said["answer"] = (
                expanded_by_xacro(request) if kind == "xacro" else vehicle_by_mujoco(request)
            )
    except EqtError as error:
        said["error"] = str(error)
    except ImportError as error:
        said["error"] = f"{shown(request.path)}: {TITLES[kind]} cannot be imported: {error}"
    except MemoryError:
        os._exit(LACKS_MEMORY)
    said |= {"left_out": sorted(request.names_left_out), "offered": sorted(request.names_offered)}
    out.write(json.dumps(said).encode())
    out.flush()
    os._exit(0)  # what MuJoCo has built need not be taken apart


def expanded_by_xacro(request: Request) -> str:
    """Return the text that xacro makes of a file."""
    import xacro

    from eqt_cli.extensions.vehicles.macros import expanded

    _limit_time_and_memory()
    return expanded(xacro, request)


def vehicle_by_mujoco(request: Request) -> dict[str, Any]:
    """Return the vehicle that MuJoCo reads in a file, as data for JSON."""
    import mujoco

    from eqt_cli.extensions.vehicles.mjcf import vehicle_of

    _limit_time_and_memory()
    vehicle = asdict(vehicle_of(mujoco, request))
    record: dict[str, Any] = json.loads(json.dumps(vehicle, default=lambda x: x.tolist()))
    return record


def _limit_time_and_memory() -> None:
    """Limit this process from here on, where the system can: not on Windows."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        seconds = math.ceil(process_time() + SECONDS)
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, resource.getrlimit(0)[1]))
        pages = int(Path("/proc/self/statm").read_text().split()[0])  # Linux
        most = pages * resource.getpagesize() + MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
