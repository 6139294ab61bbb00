"""Which definitions of a header a text needs, and what of a header is for one lane."""

from eqt_cli.extensions.firmware.c_headers import FLOAT_HEADER, _of_one_lane, headers, needed

HEADER = """\
/* About all of it,

   in several lines; */

/* Types ---------------------------------------- */

typedef double eqt_real;
typedef struct {
    eqt_real low, high;
} eqt_range;

/* One;
   it is enough. */
EQT_INLINE eqt_real eqt_one(void)
{
    return 1.0; /* { */
}

#define EQT_TWO 2.0

/* In two lines. */
#define EQT_THREE(x) \\
    x = 3.0;
static const double eqt_table[] = {
    1.0,

    2.0};

/* Functions ------------------------------------ */

EQT_INLINE eqt_real eqt_four(eqt_real x)
{
    if (x > EQT_TWO) {
        return eqt_one();
    }

    return eqt_one();
}

#ifdef __clang__
#if EQT_WIDE
EQT_INLINE eqt_real eqt_five(eqt_range x) { return x.low; }

#endif
#else
EQT_INLINE eqt_real eqt_five(eqt_range x) { return x.high; }
#endif
#ifndef EQT_SIX
#define EQT_SIX EQT_THREE
#endif
"""
REAL = "typedef double eqt_real;\n"
ONE = """\
/* One;
   it is enough. */
EQT_INLINE eqt_real eqt_one(void)
{
    return 1.0; /* { */
}
"""
FOUR = """\
EQT_INLINE eqt_real eqt_four(eqt_real x)
{
    if (x > EQT_TWO) {
        return eqt_one();
    }

    return eqt_one();
}
"""
RANGE = "typedef struct {\n    eqt_real low, high;\n} eqt_range;\n"
FIVE = HEADER[HEADER.index("#ifdef __clang__") : HEADER.index("#ifndef EQT_SIX")]
TABLE = "static const double eqt_table[] = {\n    1.0,\n\n    2.0};\n"
THREE = "/* In two lines. */\n#define EQT_THREE(x) \\\n    x = 3.0;\n"
SIX = "#ifndef EQT_SIX\n#define EQT_SIX EQT_THREE\n#endif\n"


def test_what_a_text_needs_directly_or_not_is_picked_with_its_comments():
    for text, expected in {
        "x = 1;": [],
        "eqt_one();": [REAL, ONE],
        "eqt_four(x);": [REAL, ONE, "#define EQT_TWO 2.0\n", FOUR],
        "eqt_five(x);": [REAL, RANGE, FIVE],
        "eqt_table[0]": [TABLE],
        "EQT_SIX": [THREE, SIX],
    }.items():
        assert needed(text, HEADER) == "\n".join(expected), text


def test_a_header_may_begin_with_a_definition():
    assert needed("eqt_real x;", REAL) == REAL


def test_what_a_text_defines_itself_is_left_out():
    text = f"{REAL}#define EQT_TWO 2.5\neqt_four(x);"
    assert needed(text, HEADER) == "\n".join([ONE, FOUR])


GUARDED = """\
#ifndef EQT_SOME_H
#define EQT_SOME_H
#include <math.h>
#ifndef EQT_LANES
#define EQT_LANES 4
#ifdef __AVX__
#define EQT_WIDE 1
#endif
#endif
#if EQT_LANES == 1
one
#ifdef __clang__
#if EQT_LANES == 1
clang
#else
clang on lanes
#endif
#elif __GNUC__
gcc
#else
other
#endif
#else
several
#ifdef __AVX__
wide
#else
narrow
#endif
#endif
#ifndef EQT_NAN
nan of EQT_LANES
#endif
#if EQT_LANES == 1
one again
#endif
end
#endif
"""


def test_a_header_for_one_lane_has_no_conditions_on_lanes_and_no_guard():
    assert _of_one_lane(GUARDED) == (
        "one\n#ifdef __clang__\nclang\n#elif __GNUC__\ngcc\n#else\nother\n#endif\n"
        "#ifndef EQT_NAN\nnan of 1\n#endif\none again\nend"
    )


def test_numbers_in_float_have_functions_of_their_own():
    single, double = headers("float"), headers("double")
    assert single == _of_one_lane(FLOAT_HEADER.read_text(encoding="utf-8"))
    assert "typedef float eqt_real;" in single
    assert "typedef double eqt_real;" in double
