"""`python -m mutants`: plants faults in the mathematical core, chosen by a seed, one at a time.

With `--extension NAME`, in an extension, which the tests in its folder must tell.
Tries each on the tests that reach it and says which are not told. Those in equivalent.yaml, which
change nothing that can be seen, do not count. Outcomes are kept in build/mutants, so that a second
call goes on, or tries the survivors `--again`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest
import yaml

from mutants.mutations import CORE, Mutant, mutants_of, source_files
from mutants.trials import KILLED, KNOWN, ROOT, SURVIVED, TIMEOUT, UNTESTED, Trials

TESTS = (
    *(
        f"tests/{folder}"
        for folder in (
            "numbers",
            "components",
            "loop",
            "config",
            "engines",
            "results",
            "runs",
            "extensions",
            "analysis/test_bootstrap.py",
            "analysis/test_comparison.py",
            "analysis/test_shares.py",
            "analysis/test_verdict.py",
            "analysis/test_findings.py",
            "trust/test_input.py",
        )
    ),
    *(
        f"tests/contracts/test_{kind}.py"
        for kind in (
            "controllers",
            "designs",
            "engines",
            "groups",
            "poses",
            "programs",
            "references",
            "vehicle",
            "velocities",
        )
    ),
)
"""The tests of the core, of which those that are marked `ci` are left out."""

EQUIVALENT = Path(__file__).with_name("equivalent.yaml")


def main() -> int:
    """1 if more than `--least` of the mutants that count are not told."""
    options = _options()
    equivalent = yaml.safe_load(EQUIVALENT.read_text(encoding="utf-8")) or {}
    drawn = _drawn(options)
    sample = [mutant for mutant in drawn if mutant.key not in equivalent][: options.count]
    name = "-".join(filter(None, (options.extension, "quick" if options.quick else "")))
    kept = KNOWN / f"seed-{options.seed}{name and '-' + name}.json"
    known: dict[str, list[str]] = json.loads(kept.read_text()) if kept.exists() else {}

    def done(mutant: Mutant, outcome: str, told: str) -> None:
        known[mutant.key] = [outcome, told]
        kept.write_text(json.dumps(known, ensure_ascii=False, indent=0))
        print(f"{outcome:9} {mutant.line:4} {mutant.key}  {told}", flush=True)

    still = [m for m in sample if _is_open(known.get(m.key), options.again)][: options.trials]
    if still:
        _try(still, options, done)
    return _report(sample, known, options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m mutants", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="which mutants are drawn")
    parser.add_argument("--count", type=int, default=300, help="how many count")
    parser.add_argument("--extension", default="", help="in this extension, in place of the core")
    parser.add_argument("--only", default="", help="in files whose path contains this")
    parser.add_argument("--trials", type=int, help="at most so many now")
    parser.add_argument("--quick", action="store_true", help="by the tests of `make test` alone")
    parser.add_argument("--again", action="store_true", help="try survivors anew")
    parser.add_argument(
        "--tests", action="append", default=[], help="further tests of the extension"
    )
    parser.add_argument(
        "--ignore", action="append", default=[], help="a file of tests to leave out"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--least", type=float, default=0.95, help="share that must be told")
    return parser.parse_args()


def _drawn(options: argparse.Namespace) -> list[Mutant]:
    """All mutants there are, in the order of the seed: a change of one file moves no other's."""
    places = [f"extensions/{options.extension}"] if options.extension else CORE
    files = [file for file in source_files(ROOT, places) if options.only in file.as_posix()]
    found = [mutant for file in files for mutant in mutants_of(ROOT, file)]
    order = {m.key: sha256(f"{options.seed} {m.key}".encode()).digest() for m in found}
    return sorted(found, key=lambda mutant: order[mutant.key])


def _is_open(outcome: list[str] | None, again: bool) -> bool:
    return outcome is None or (again and outcome[0] in (SURVIVED, UNTESTED))


def _try(
    mutants: list[Mutant], options: argparse.Namespace, done: Callable[[Mutant, str, str], None]
) -> None:
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    if not options.quick:
        os.environ["EQT_TIERS"] = "off"  # tests/tiers.tsv leaves none out
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PYTEST_DEBUG_TEMPROOT"] = folder
        ignored = [f"--ignore={file}" for file in options.ignore]
        fast = ["-m", "not ci", "-p", "no:cacheprovider", "-p", "no:xdist"]
        tests = ("tests",) if options.quick else TESTS
        if options.extension:
            tests = (f"tests/extensions/{options.extension}", *options.tests)
        arguments = ["-q", "-s", *fast, *ignored, *tests]
        code = pytest.main(arguments, plugins=[Trials(mutants, options.workers, done)])
    if code:
        sys.exit(f"the tests of the core cannot be run: {code!r}")


def _report(sample: list[Mutant], known: dict[str, list[str]], options: argparse.Namespace) -> int:
    tried = [mutant for mutant in sample if mutant.key in known]
    counts = Counter(known[mutant.key][0] for mutant in tried)
    told = counts[KILLED] + counts[TIMEOUT]
    untold = [mutant for mutant in tried if known[mutant.key][0] in (SURVIVED, UNTESTED)]
    for mutant in sorted(untold, key=lambda mutant: mutant.key):
        print(f"{known[mutant.key][0]}: {mutant.path}:{mutant.line} {mutant.key.partition(' ')[2]}")
    share = told / max(len(tried), 1)
    print(
        f"seed {options.seed}: {told} of {len(tried)} mutants told ({share:.1%}), "
        f"{counts[TIMEOUT]} of them by their time; {len(sample) - len(tried)} not tried yet"
    )
    return 0 if share >= options.least else 1


if __name__ == "__main__":
    sys.exit(main())
