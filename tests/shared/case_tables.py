"""Cases of tests: in YAML files, those of CI, and what an error says."""

from functools import cache
from pathlib import Path

import pytest
import yaml


def from_yaml(test):
    """Try a test on its cases in the file beside it: `sweep.yaml` of `test_sweep.py`.

    There a case is a mapping of arguments, below the name of the test; `id` names the case where
    its arguments do not, and `ci` says why only CI tries it. A mapping alone is its own name.
    """
    table = table_of(test)
    names = [name for name in table[0] if name not in ("id", "ci")]
    cases = []
    for case in table:
        assert case.keys() <= {*names, "id", "ci"}, case
        marks = [pytest.mark.ci(case["ci"])] if "ci" in case else []
        values = [case[name] for name in names]
        alone = str(*values) if len(values) == 1 else None
        cases.append(pytest.param(*values, id=case.get("id", alone), marks=marks))
    return pytest.mark.parametrize(names, cases)(test)


def table_of(test):
    """The cases of a test in the file beside it."""
    path = Path(test.__code__.co_filename)
    return _tables(path.with_name(f"{path.stem.removeprefix('test_')}.yaml"))[test.__name__]


@cache
def _tables(path):
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # as eqt reads YAML, fast
    return yaml.load(path.read_text(encoding="utf-8"), loader)  # noqa: S506


def in_ci(why, *values, unless=False, **more):
    """A case of a test that only CI tries, unless something holds of it."""
    return pytest.param(*values, marks=[] if unless else [pytest.mark.ci(why)], **more)


def refusal(error, function, *arguments, **named):
    """What this error says, which a call must raise."""
    with pytest.raises(error) as caught:
        function(*arguments, **named)
    return str(caught.value)
