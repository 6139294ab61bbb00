"""Cases of tests: as a text that reads like a file, those of CI, and what an error says."""

import pytest


def cases(text):
    """The pairs (given, said) of a text: what is said is indented, below what it is said of.

    Lines that are given are kept as lines; those of a message are joined by spaces. A line that
    begins with # is a comment.
    """
    pairs = []
    for line in text.strip("\n").splitlines():
        if line.startswith("#"):
            continue
        if line.startswith("    "):
            pairs[-1][1].append(line.strip())
        elif pairs and not pairs[-1][1]:
            pairs[-1][0].append(line)
        else:
            pairs.append(([line], []))
    return [("\n".join(written), " ".join(said)) for written, said in pairs]


def in_ci(why, *values, unless=False, **more):
    """A case of a test that only CI tries, unless something holds of it."""
    return pytest.param(*values, marks=[] if unless else [pytest.mark.ci(why)], **more)


def refusal(error, function, *arguments, **named):
    """What this error says, which a call must raise."""
    with pytest.raises(error) as caught:
        function(*arguments, **named)
    return str(caught.value)
