"""The check of the sections for searches; it loads no search for a configuration without one."""

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtWarning
from eqt_cli.base.reporting import reporter
from eqt_cli.config.document import Document


@purposes.check_of_a_configuration
def check(document: Document) -> None:
    """Check the sections for searches of a configuration; they may raise a `ConfigError`."""
    if document.data.get("tune"):
        from eqt_cli.extensions.search.tune import Search

        search = Search.read(document)
        search.remark_on_ends()
        for remark in search.remarks():
            reporter().remark(EqtWarning(remark))
    if document.data.get("worst"):
        from eqt_cli.extensions.search.worst import WorstSearch

        WorstSearch.read(document).remark_on_ends()
