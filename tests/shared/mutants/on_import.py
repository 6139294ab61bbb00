"""One mutant in what is executed on import, in an interpreter of its own."""

import os
import sys

import pytest

from mutants.mutations import mutants_of
from mutants.trials import ROOT, first_failure, plant_on_reading


class FirstFailure:
    """A plugin of pytest that runs the tests in the order given, until one fails."""

    failed = "collection"

    def __init__(self, order: list[str]) -> None:
        self.order = order

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """All of them, or less."""
        found = {item.nodeid: item for item in session.items}
        if not session.testsfailed:
            self.failed = first_failure(found[nodeid] for nodeid in self.order)
        return True


def main(path: str, line: str, key: str, write: str, *chosen: str) -> int:
    """1 if a test fails, or the file cannot be read any more."""
    [mutant] = [each for each in mutants_of(ROOT, ROOT / path) if each.key == key]
    plant_on_reading(mutant)
    tests = FirstFailure(list(chosen))
    files = sorted({nodeid.partition("::")[0] for nodeid in chosen})
    pytest.main(["-q", "-p", "no:cacheprovider", "-p", "no:xdist", *files], plugins=[tests])
    os.write(int(write), tests.failed.encode())
    return 1 if tests.failed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
