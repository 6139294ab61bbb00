"""What sections for searches say; it loads no search for a configuration without one."""

from collections.abc import Iterator

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


@purposes.seeds_of_judges
def seeds_of_judges(document: Document) -> Iterator[tuple[str, int]]:
    """Yield the seed of the held-out runs of a tuning."""
    if tune := document.data.get("tune"):
        from eqt_cli.base.errors import Problems
        from eqt_cli.base.option_types import validated
        from eqt_cli.extensions.search.keys import TuneSection
        from eqt_cli.extensions.search.tune import confirming_seed

        section = validated(TuneSection, tune, Problems())
        first = (document.data.get("ensemble") or {}).get("seed", 0)
        if section is not None:
            yield "tune.confirm.seed", confirming_seed(section, first)
