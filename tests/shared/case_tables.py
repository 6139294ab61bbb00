"""Cases of tests: as a text that reads like a file, slow ones, and what an error says."""

import pytest


def cases(text):
    """The pairs (given, said) of a text: what is said is indented, below what it is said of.

    Lines that are given are kept as lines; those of a message are joined by spaces. A line that
    begins with # is a comment.
    """
    found = []
    for line in text.strip("\n").splitlines():
        if line.startswith("#"):
            continue
        if line.startswith("    "):
            found[-1][1].append(line.strip())
        elif found and not found[-1][1]:
            found[-1][0].append(line)
        else:
            found.append(([line], []))
    return [("\n".join(given), " ".join(said)) for given, said in found]


def slow(why, *values, unless=False, **more):
    """A case of a test that is marked as slow, unless something holds of it."""
    return pytest.param(*values, marks=[] if unless else [pytest.mark.slow(why)], **more)


def refusal(error, function, *given, **named):
    """What this error says, which a call must raise."""
    with pytest.raises(error) as caught:
        function(*given, **named)
    return str(caught.value)
