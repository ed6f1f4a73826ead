"""Questions about rows: they mean what Python means, and nothing in them is executed."""

import math
import operator

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.study.listing import satisfying
from experiments.study.query import LONGEST, Question
from experiments.study.study import WrongInput
from experiments.study.units import named_otherwise, split

SCHEMA = pa.schema(
    [
        ("delay_ms", pa.float64()),
        ("strut", pa.int64()),
        ("kind", pa.string()),
        ("right", pa.bool_()),
        ("kinds", pa.list_(pa.string())),
    ]
)
ROW = st.fixed_dictionaries(
    {
        "delay_ms": st.none() | st.sampled_from([math.nan, math.inf, -70.0, 0.0, 69.0, 70.0, 71.5]),
        "strut": st.none() | st.integers(-1, 3),
        "kind": st.none() | st.sampled_from(["locked", "free", "ü", ""]),
        "right": st.none() | st.booleans(),
    }
)
COMPARED = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
    "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
CALCULATED = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


def is_missing(value) -> bool:
    return value is None or (isinstance(value, float) and math.isnan(value))


def compared(op, a, b) -> bool:
    return not is_missing(a) and not is_missing(b) and bool(COMPARED[op](a, b))


def calculated(op, a, b):
    if is_missing(a) or is_missing(b):
        return None
    with np.errstate(all="ignore"):
        return float(CALCULATED[op](float(a), float(b)))


def number(name, factor=1.0):
    def of(row):
        value = row[name]
        return None if value is None else float(value) / factor

    return of


NUMBERS = st.recursive(
    st.sampled_from(
        [
            ("delay_ms", number("delay_ms")),
            ("delay_s", number("delay_ms", 1e3)),
            ("strut", number("strut")),
            ("0.07", lambda _: 0.07),
            ("1", lambda _: 1.0),
            ("-70", lambda _: -70.0),
        ]
    ),
    lambda inner: st.builds(
        lambda a, op, b: (
            f"({a[0]} {op} {b[0]})",
            lambda row: calculated(op, a[1](row), b[1](row)),
        ),
        inner,
        st.sampled_from(list(CALCULATED)),
        inner,
    ),
    max_leaves=3,
)
TEXTS = st.sampled_from(
    [
        ("kind", lambda row: row["kind"]),
        ("'locked'", lambda _: "locked"),
        ('"ü"', lambda _: "ü"),
    ]
)
TRUTHS = st.sampled_from(
    [("right", lambda row: row["right"]), ("True", lambda _: True), ("False", lambda _: False)]
)


def comparisons(terms, ops):
    """One comparison, or a chain of two."""

    def said(first, second, third, op, other, chained):
        text = f"{first[0]} {op} {second[0]}" + (f" {other} {third[0]}" if chained else "")

        def holds(row):
            a, b, c = (each[1](row) for each in (first, second, third))
            return compared(op, a, b) and (not chained or compared(other, b, c))

        return text, holds

    op = st.sampled_from(ops)
    return st.builds(said, terms, terms, terms, op, op, st.booleans())


def membership(terms):
    def said(one, others, wanted):
        values = "".join(f"{each[0]}, " for each in others)

        def holds(row):
            value, its = one[1](row), [each[1](row) for each in others]
            found = any(compared("==", value, each) for each in its)
            apart = not is_missing(value) and all(compared("!=", value, each) for each in its)
            return found if wanted else apart

        return f"{one[0]} {'in' if wanted else 'not in'} ({values})", holds

    return st.builds(said, terms, st.lists(terms, max_size=3), st.booleans())


def absence(one, words):
    wanted = words in ("is", "==")
    return f"{one[0]} {words} None", lambda row: is_missing(one[1](row)) == wanted


ATOMS = st.one_of(
    comparisons(NUMBERS, list(COMPARED)),
    comparisons(TEXTS, list(COMPARED)),
    comparisons(TRUTHS, ["==", "!="]),
    membership(NUMBERS),
    membership(TEXTS),
    st.builds(absence, NUMBERS | TEXTS, st.sampled_from(["is", "is not", "==", "!="])),
    TRUTHS.map(lambda each: (each[0], lambda row: each[1](row) is True)),
)
CONDITIONS = st.recursive(
    ATOMS,
    lambda inner: st.one_of(
        inner.map(lambda a: (f"not ({a[0]})", lambda row: not a[1](row))),
        st.builds(
            lambda a, word, b: (
                f"({a[0]}) {word} ({b[0]})",
                lambda row: (all if word == "and" else any)(each[1](row) for each in (a, b)),
            ),
            inner,
            st.sampled_from(["and", "or"]),
            inner,
        ),
    ),
    max_leaves=4,
)


def table(rows) -> pa.Table:
    numbered = [row | {"kinds": None} for row in rows]
    return pa.Table.from_pylist(numbered, SCHEMA).append_column("case", pa.array(range(len(rows))))


def cases(rows, question: str, by: str | None = None) -> list[int]:
    found = table(rows)
    worst = by and Question(by, found.schema)
    return satisfying(found, Question(question, found.schema), worst or None)["case"].to_pylist()


@given(st.lists(ROW, max_size=12), CONDITIONS)
def test_a_question_finds_the_rows_that_plain_python_finds(rows, condition):
    """A missing number or word satisfies no comparison."""
    text, holds = condition
    assert cases(rows, text) == [k for k, row in enumerate(rows) if holds(row)]


@given(st.lists(ROW, max_size=12), NUMBERS)
def test_the_worst_come_first_and_rows_without_the_number_last(rows, by):
    text, of = by
    values = [of(row) for row in rows]
    order = sorted((k for k, v in enumerate(values) if not is_missing(v)), key=lambda k: -values[k])
    # Sizes of the values are far apart, or they are equal.
    expected = [*order, *(k for k, v in enumerate(values) if is_missing(v))]
    found = cases(rows, "True", text)
    assert [values[k] for k in found] == pytest.approx([values[k] for k in expected], nan_ok=True)


@pytest.mark.parametrize(
    ("question", "found"),
    [
        ("delay_ms != 70", []),
        ("not delay_ms != 70", [0, 1]),
        ("delay_ms not in (70,)", []),
        ("delay_ms is None", [0, 1]),
        ("strut / strut == 1", []),
        ("1 / strut > 1e300", [0]),
        ("kind != 'free'", [0]),
    ],
)
def test_nothing_follows_from_a_missing_number_and_zero_divides(question, found):
    nan = {"delay_ms": math.nan, "strut": 0, "kind": "", "right": True}
    none = {"delay_ms": None, "strut": None, "kind": None, "right": None}
    assert cases([nan, none], question) == found


@pytest.mark.parametrize("ms", [9.0, 57.0, 70.0, 1e-3, 123456.0])
def test_a_time_in_seconds_is_exactly_that_in_milliseconds(ms):
    row = {"delay_ms": ms, "strut": 1, "kind": "free", "right": True}
    assert cases([row], f"delay_s == {ms / 1e3!r}") == [0]


@pytest.mark.parametrize(
    ("name", "known", "factor"),
    [
        ("named_s", "named_ms", 1e-3),
        ("rms_mrad", "rms_urad", 1e-3),
        ("rms_deg", "rms_rad", 180 / math.pi),
        ("gap_nm", "gap_m", 1e9),
        ("gap_um", "gap_mm", 1e3),
        ("left_percent", "left", 100.0),
        ("left", "left_percent", 0.01),
    ],
)
def test_a_unit_is_that_of_the_quantity(name, known, factor):
    own, found = named_otherwise(name, ["other", known]) or ("", 0.0)
    assert own == known and found == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("name", ["gain_rad_per_mm", "gain_rad_per_ms", "named_m", "m", "_s"])
def test_a_rate_or_another_quantity_is_not_converted(name):
    known = ["gain_rad_per_m", "gain_rad_per_s", "named_ms", "ms"]
    assert named_otherwise(name, known) is None
    assert split("gain_rad_per_m") == ("gain_rad_per_m", "")


WRONG = {
    "": "1 to 1000 characters, got 0",
    "   ": "1 to 1000 characters, got 0",
    "x" * (LONGEST + 1): "1 to 1000 characters, got 1001",
    "delay_sm > 1": "no run has 'delay_sm'; did you mean \"delay_ms\"?",
    "__row > 1": "no run has '__row'",
    "strut > > 1": "at character 9, '> 1': invalid syntax",
    "(strut > 1": "at character 1, '(strut > 1'",
    "strut > 1)": "at character 10, ')': unmatched ')'",
    "strut = 1": "at character",
    "kind > 0.1": "kind is text and 0.1 a number",
    "strut == 'locked'": "strut is a number and 'locked' text",
    "right == 1": "right is true or false and 1 a number",
    "right < True": "neither more nor less",
    "None < 1": "None is neither more nor less",
    "kind": "kind is text, expected a comparison",
    "strut + 1": "strut + 1 is a number, expected a comparison",
    "kind + 'x' == 'y'": "kind is text, expected a number",
    "-kind < 1": "kind is text, expected a number",
    "kind is 'free'": "`is` goes with None alone",
    "kind in 'free'": "goes with values in parentheses",
    "kind in (1, 2)": "kind is text and 1 a number",
    "kinds == 'a'": "kinds is no number, no text",
    "'ü' == kind and strut ==": "invalid syntax",
    "kind == 'ü' and strut @ 1 > 2": "at character 17, 'strut @ 1 > 2'",
    "strut < 1" + "0" * 400: "too large",
    "kind == b'free'": "a question has names",
    "strut < 1j": "a question has names",
    "kind == f'{strut}'": "a question has names",
    "strut ** 2 > 1": "a question has names",
    "strut.real > 1": "a question has names",
    "strut[0] > 1": "a question has names",
    "(lambda: strut)() > 1": "a question has names",
    "[strut for strut in kinds] == 1": "a question has names",
    "(strut := 1) > 0": "a question has names",
    "strut > 1 if right else 2": "a question has names",
    "__import__('os').mkdir('executed') == 1": "a question has names",
    "open('executed', 'w') is None": "a question has names",
    "strut > 1; import os": "at character 10",
    "import os": "at character 1",
    "strut > 1\x00": "null bytes",
    "\ud800 > 1": "it cannot be read",
    "(" * 400 + "strut" + ")" * 400 + " > 1": "at character",
    "9" * 900 + " > strut": "too large",
}


@pytest.mark.parametrize("question", WRONG)
def test_what_is_no_question_is_one_sentence_that_points_at_the_place(
    question, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WrongInput) as refused:
        Question(question, SCHEMA.append(pa.field("__row", pa.int64()))).condition()
    said = str(refused.value)
    assert WRONG[question] in said and "\n" not in said and len(said) < 600
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "question", ["not " * 240 + "right", "-" * 990 + "1 > 0", "(" * 150 + "right" + ")" * 150]
)
def test_deep_nesting_is_read_or_refused(question):
    try:
        assert cases([{"delay_ms": 1.0, "strut": 1, "kind": "", "right": True}], question) == [0]
    except WrongInput as refused:
        assert "nested" in str(refused)


@given(st.text(max_size=60))
def test_any_text_is_a_question_or_one_sentence(text):
    try:
        Question(text, SCHEMA).condition()
    except WrongInput as refused:
        assert "\n" not in str(refused)


@given(
    st.lists(st.sampled_from([*"()[]{},.:=<>!+-*/'\"", " strut ", " not ", " in ", "1", "None"]))
)
def test_any_words_are_a_question_or_one_sentence(words):
    try:
        Question("".join(words), SCHEMA).condition()
    except WrongInput as refused:
        assert "\n" not in str(refused)


def test_what_a_question_names_is_a_column_by_the_name_it_gives_it():
    row = {"delay_ms": 70.0, "strut": 1, "kind": "free", "right": None}
    found = table([row])
    asked = Question("delay_s > 0.01 and kind != 'x'", found.schema)
    named = satisfying(found, asked, Question("delay_us / 2", found.schema))
    assert list(asked.asked) == ["delay_s", "kind"]
    assert named["delay_s"].to_pylist() == [0.07]
    assert named["delay_us / 2"].to_pylist() == [35_000.0]
