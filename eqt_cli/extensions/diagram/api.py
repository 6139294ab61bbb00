"""The diagram of an experiment, for Python and for notebooks."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.api.loading import Configuration, document_from, experiment_at
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import check_targets, write_all
from eqt_cli.base.yaml_source import flow

if TYPE_CHECKING:
    from eqt_cli.config.study import Study
    from eqt_cli.results.result import Result


class LoopDiagram:
    """The loop of an experiment as a block diagram; a notebook shows the picture."""

    def __init__(self, drawing: Any) -> None:
        self._drawing = drawing

    def text(self) -> str:
        """Return it as text of 80 columns."""
        from eqt_cli.extensions.diagram.text import text

        return text(self._drawing)

    def svg(self, *, narrow: bool = False) -> str:
        """Return it as SVG, 180 mm wide, or `narrow`, for screens of phones."""
        from eqt_cli.extensions.diagram.picture import svg

        return svg(self._drawing, narrow=narrow)

    def html(self) -> str:
        """Return it as a part of a page, which shows the narrow picture on narrow screens."""
        from eqt_cli.extensions.diagram.picture import html

        return html(self._drawing)

    def save(self, path: str | os.PathLike[str], *, narrow: bool = False) -> Path:
        """Write it to a file, .svg or .html.

        Raises
        ------
        EqtError
            If the name has another ending, or the file cannot be written.
        """
        from eqt_cli.extensions.diagram.picture import page

        target = Path(path)
        if target.suffix not in (".svg", ".html"):
            raise EqtError(f"{target}: a diagram is written as .svg or .html; choose one of these")
        text = self.svg(narrow=narrow) if target.suffix == ".svg" else page(self._drawing)
        check_targets([target], target.parent)
        write_all({target: text.encode()}, target.parent)
        return target

    def __repr__(self) -> str:
        return self.text()

    def _repr_html_(self) -> str:
        return self.html()


def diagram(
    config: Study | Configuration,
    overrides: Mapping[str, Any] | None = None,
    *,
    point: int | None = None,
    trust_plugins: bool = False,
) -> LoopDiagram:
    """Draw the loop of a configuration as a block diagram, with what differs between its laws.

    Parameters
    ----------
    config
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    overrides
        Values by key, as for `load_experiment`.
    point
        Point of a sweep, counted from 0. Default: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.

    Returns
    -------
    LoopDiagram
        Printed, it is text; a notebook shows it as a picture; `save` writes a file.

    Raises
    ------
    ConfigError
        If the configuration is invalid.

    Examples
    --------
    >>> eqt_cli.diagram("paper").save("paper.svg").name
    'paper.svg'
    """
    from eqt_cli.config.study import Study
    from eqt_cli.config.study import study as checked
    from eqt_cli.extensions.diagram.diagram import diagram_of

    study = config
    if not isinstance(study, Study):
        settings = {f"overrides[{k!r}]": f"{k}={flow(x)}" for k, x in (overrides or {}).items()}
        document = document_from(study, settings, trust_plugins=trust_plugins)
        study = checked(document, most_checked=1)  # one point is drawn
    if point is not None:
        return LoopDiagram(diagram_of(experiment_at(study, point)))
    return LoopDiagram(diagram_of(study.base, study.sweep.keys if study.sweep else ()))


@purposes.diagram_of_a_report
def of_result(result: Result, trust_plugins: bool) -> str:
    """Return the diagram of an open result as a part of a page.

    Raises
    ------
    EqtError
        If the result has plugins that are not trusted, or its configuration cannot be read.
    """
    from eqt_cli.config.document import document_of
    from eqt_cli.config.study import study as checked

    return diagram(checked(document_of(result, trust_plugins), most_checked=1)).html()
