"""What is found in a C text that decides: comparisons, conditions and labels."""

import pytest

from eqt_cli.extensions.code.decisions import watched

TEXT = (
    '# 1 "a.c"\nint f(int a, int b, int *p) {{\n{body}\n}}\n'
    '# 1 "eqt.c"\nint g(void) {{ f(1, 2, 0); }}'
)

BODIES = {
    "if (a < b) a = 1;": ["a < b"],
    "return a & b == 2;": ["b == 2"],
    "return p == &b;": ["p == &b"],
    "return &b == p;": ["&b == p"],
    "return p == &b && a;": ["p == &b"],
    "return a + b * 2 > (a | 1);": ["a + b * 2 > (a | 1)"],
    "if (a < b && b) a = 1;": ["a < b && b", "a < b"],
    "return p[a < b] >= -1;": ["a < b", "p[a < b] >= -1"],
    "if (a == 1) b = a != 2 ? 3 : 4;": ["a == 1", "a != 2"],
    "while (b) --b;": ["b"],
    "for (a = 0; a < 3; ++a) b += a;": ["a < 3"],
    "for (a = 9; a; --a) b += a;": ["a"],
    "b = a ? 1 : 2;": ["a"],
    "if (a) return b > 1;": ["a", "b > 1"],
    # The compiler decides these, or they are no operands of their own.
    "while (1) break;": [],
    "static int c = 1 < 2; return c;": [],
    "enum { E = 1 < 2 }; return E;": [],
    "return a < b < 3;": [],
    "return sizeof(a) == 4;": [],
    "return f(a, b, p);": [],
    "switch (a) { case 1: b = 2; break; default: b = 3; }": ["case 1", "default"],
}


@pytest.mark.parametrize("body", BODIES)
def test_decisions_of_a_function_are_found_with_their_lines(body):
    _, (start, *decisions) = watched(TEXT.format(body=body), {"a.c"})
    assert (start.text, start.place, start.is_function) == ("f", "a.c, line 1", True)
    assert [each.text for each in decisions] == BODIES[body]
    assert {each.place for each in decisions} <= {"a.c, line 2"}
    assert all(each.is_label == body.startswith("switch") for each in decisions)


def test_only_functions_that_are_called_count():
    text = '# 1 "a.c"\nint h(int a) { return a < 1; }\n' + TEXT.format(body="return a > 1;")
    assert [each.text for each in watched(text, {"a.c"})[1]] == ["f", "a > 1"]
