"""`eqt live`: an experiment that runs in a page."""

from pathlib import Path
from typing import Annotated

from eqt_cli.cli import options
from eqt_cli.cli.output import print_findings


def live(
    config: options.Config,
    out: Annotated[Path, options.option("--out")],
    key: Annotated[list[str] | None, options.option("--key")] = None,
    title: Annotated[str, options.option("--title")] = "",
    set_: options.Set = None,
    workers: options.Workers = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Write one page that runs all laws again at every move of a slider, without eqt.

    It integrates in the browser, by the compiled programs of the engine native. It needs a compiler
    for WebAssembly, and only to be written: the extra `live`.

    Options
    -------
    What to show
        --key KEY=LOW:HIGH  A key to move and its range, LOW:HIGH or LOW:HIGH:STEP. Repeatable.
            Default: those of `live` in the configuration, or gains, inertia and the start.
        --title TEXT  Title. Default: the first sentence of the configuration's first comment.
    Result
        --out FILE  Page to write.
    """
    from eqt_cli import api
    from eqt_cli.base.yaml_source import parse_value
    from eqt_cli.extensions.live.api import ranges

    changes = options.pairs("--set", set_, "KEY=VALUE")
    path = api.live(
        config,
        out,
        keys=ranges(key or ()),
        overrides={name: parse_value(text, "--set") for name, text in changes.items()},
        title=title,
        workers=workers or options.cores(),
    )
    size = path.stat().st_size
    print_findings(
        {"page": str(path), "bytes": size}, f"page     {path}  ({size / 1e3:.0f} kB)", json=json
    )
