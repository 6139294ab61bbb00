"""The check of the section `live`; it loads no engine for a configuration without one."""

from eqt_cli.base.errors import EqtError, Problems, parse_key
from eqt_cli.config.document import Document, value_at
from eqt_cli.config.schema import SHAPES, marks_of, not_swept


def check(document: Document) -> None:
    """Check the keys of `live` and their ranges.

    Whether a key changes more than numbers, only `eqt live` finds out.

    Raises
    ------
    ConfigError
        With all that is wrong.
    """
    problems = Problems(document.place)
    for key, range_ in (document.data.get("live") or {}).items():
        from eqt_cli.extensions.live.sliders import Slider

        here = problems.at("live", key)
        try:
            path = parse_key(key)
            why = not_swept(key) or (SHAPES in marks_of(key) and SHAPES.value)
            if why:
                here.add(f"no slider can move it; it {why}")
            else:
                Slider.of(key, value_at(document.data, path), range_)
        except EqtError as error:
            here.add(str(error.args[0]).removeprefix(f"{key}: "))
    problems.raise_if_any()
