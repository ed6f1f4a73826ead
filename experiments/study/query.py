"""Questions about rows in the words of Python: comparisons of columns, as expressions of Arrow.

Nothing is evaluated as Python: a question is parsed, and what is not among the comparisons below is
refused. A missing number or word satisfies no comparison, `!=` and `not in` included; `x is None`
asks for it, and `not` of a comparison is true where the comparison is not.
"""

import ast
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from itertools import pairwise
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from experiments.study.spelling import nearest
from experiments.study.study import WrongInput
from experiments.study.units import named_otherwise

LONGEST = 1000
"""Characters of a question."""

HIDDEN = "__"
"""Columns whose names begin so are not asked for."""

_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b,
    ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b,
    ast.Eq: lambda a, b: a == b,
    ast.NotEq: lambda a, b: (a < b) | (a > b),  # of NaN neither
}
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: pc.add,
    ast.Sub: pc.subtract,
    ast.Mult: pc.multiply,
    ast.Div: pc.divide,  # the operator itself refuses zero
}
_UNDERSTOOD = (
    "a question has names, numbers, words in quotes, comparisons, `in`, `is None`, and, or, not, "
    "+ - * /"
)


@dataclass(frozen=True)
class Term:
    """A part of a question: a number, a word, or a truth value, of each row."""

    kind: str  # "a number", "text", "true or false", or "None"
    of: Any  # pc.Expression; its own of a truth value is never null where it is a condition
    said: str


@dataclass
class Question:
    """A question to the rows of a schema.

    `asked` has the columns that it names, in order, as terms by the names that it gives them.

    Raises:
        WrongInput: It is none, it names no column, or it compares what cannot be compared; the
            sentence says where.
    """

    text: str
    schema: pa.Schema
    asked: dict[str, Term] = field(default_factory=dict)

    def condition(self) -> pc.Expression:
        """Whether a row satisfies it."""
        tree = self._parsed()
        return self._reading(lambda: self._truth(tree))

    def number(self) -> pc.Expression:
        """The number that it is of a row, null or NaN where one is missing."""
        tree = self._parsed()
        return self._reading(lambda: self._number(tree))

    def _parsed(self) -> ast.expr:
        # A line break has no meaning here, and one line can be pointed at.
        text = self.text = "".join(" " if each.isspace() else each for each in self.text).strip()
        if not text or len(text) > LONGEST:
            raise WrongInput(f"a question has 1 to {LONGEST} characters, got {len(text)}")
        try:
            with warnings.catch_warnings(action="ignore"):  # of strange escapes in strings
                return ast.parse(text, mode="eval").body
        except SyntaxError as error:
            raise self._refuse((error.offset or 1) - 1, f"{error.msg}") from None
        except (ValueError, RecursionError, MemoryError):  # NUL, lone surrogates, deep nesting
            raise self._refuse(0, "it cannot be read") from None

    def _reading(self, read: Callable[[], Any]) -> Any:
        try:
            return read()
        except RecursionError:
            raise self._refuse(0, "it is nested too deeply") from None

    def _refuse(self, at: int, why: str) -> WrongInput:
        place = self.text[at : at + 30]
        where = f" at character {at + 1}, {place!r}" if place else " at its end"
        return WrongInput(f"the question {self.text!r:.200} is wrong{where}: {why}")

    def _wrong(self, node: ast.AST, why: str) -> WrongInput:
        bytes_before = getattr(node, "col_offset", 0)  # of UTF-8
        return self._refuse(len(self.text.encode()[:bytes_before].decode()), why)

    def _truth(self, node: ast.expr) -> pc.Expression:
        """A condition: true or false, never null."""
        match node:
            case ast.BoolOp(op, values):
                parts = [self._truth(each) for each in values]
                both = isinstance(op, ast.And)
                return reduce(lambda a, b: a & b if both else a | b, parts)
            case ast.UnaryOp(ast.Not(), operand):
                return ~self._truth(operand)
            case ast.Compare(left, ops, comparators):
                pairs = zip(pairwise([left, *comparators]), ops, strict=True)
                parts = [self._compared(op, *pair) for pair, op in pairs]
                return reduce(lambda a, b: a & b, parts)
        term = self._term(node)
        if term.kind != "true or false":
            raise self._wrong(node, f"{term.said} is {term.kind}, expected a comparison")
        return _known(term.of)

    def _number(self, node: ast.expr) -> pc.Expression:
        term = self._term(node)
        if term.kind != "a number":
            raise self._wrong(node, f"{term.said} is {term.kind}, expected a number")
        return term.of

    def _compared(self, op: ast.cmpop, left: ast.expr, right: ast.expr) -> pc.Expression:
        if isinstance(op, ast.In | ast.NotIn):
            return self._is_in(left, right, isinstance(op, ast.In))
        a, b = self._term(left), self._term(right)
        if "None" in (a.kind, b.kind):
            return self._is_none(op, left, a, b)
        if type(op) not in _COMPARISONS:
            raise self._wrong(left, "`is` goes with None alone")
        if a.kind != b.kind:
            raise self._wrong(left, f"{a.said} is {a.kind} and {b.said} {b.kind}")
        if a.kind == "true or false":
            if not isinstance(op, ast.Eq | ast.NotEq):
                raise self._wrong(left, f"{a.said} is {a.kind}, which is neither more nor less")
            a, b = (Term("", each.of.cast(pa.int8()), "") for each in (a, b))
        return _known(_COMPARISONS[type(op)](a.of, b.of))

    def _is_none(self, op: ast.cmpop, node: ast.expr, a: Term, b: Term) -> pc.Expression:
        if not isinstance(op, ast.Eq | ast.NotEq | ast.Is | ast.IsNot):
            raise self._wrong(node, "None is neither more nor less")
        missing = (b if a.kind == "None" else a).of.is_null(nan_is_null=True)
        return missing if isinstance(op, ast.Eq | ast.Is) else ~missing

    def _is_in(self, left: ast.expr, right: ast.expr, wanted: bool) -> pc.Expression:
        if not isinstance(right, ast.Tuple | ast.List):
            raise self._wrong(
                right, "`in` goes with values in parentheses, as in kind in ('a', 'b')"
            )
        op = ast.Eq() if wanted else ast.NotEq()
        parts = [self._compared(op, left, each) for each in right.elts]
        if wanted:
            return reduce(lambda a, b: a | b, parts, pc.scalar(False))
        return reduce(lambda a, b: a & b, parts, ~self._term(left).of.is_null(nan_is_null=True))

    def _term(self, node: ast.expr) -> Term:
        said = ast.get_source_segment(self.text, node) or ""
        match node:
            case ast.Name(name):
                return self._column(node, name)
            case ast.Constant(value):
                return self._constant(node, value, said)
            case ast.UnaryOp(ast.USub(), operand):
                return Term("a number", pc.negate(self._number(operand)), said)
            case ast.UnaryOp(ast.UAdd(), operand):
                return Term("a number", self._number(operand), said)
            case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC:
                both = self._number(left), self._number(right)
                return Term("a number", _ARITHMETIC[type(op)](*both), said)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(ast.Not()):
                return Term("true or false", self._truth(node), said)
        raise self._wrong(node, _UNDERSTOOD)

    def _constant(self, node: ast.expr, value: object, said: str) -> Term:
        if value is None:
            return Term("None", pc.scalar(None), said)
        if isinstance(value, bool):
            return Term("true or false", pc.scalar(value), said)
        if isinstance(value, str):
            return Term("text", pc.scalar(value), said)
        if isinstance(value, int | float):
            try:
                return Term("a number", pc.scalar(float(value)), said)
            except OverflowError:
                raise self._wrong(node, "the number is too large") from None
        raise self._wrong(node, _UNDERSTOOD)

    def _column(self, node: ast.expr, name: str) -> Term:
        known = [each for each in self.schema.names if not each.startswith(HIDDEN)]
        own, factor = name, 1.0
        if name not in known:
            if (found := named_otherwise(name, known)) is None:
                raise WrongInput(f"no run has {name!r}{nearest(name, known, listed=True)}")
            own, factor = found
        term = _column(own, self.schema.field(own).type)
        if term is None or (own != name and term.kind != "a number"):
            raise self._wrong(node, f"{own} is no number, no text, and not true or false")
        if factor != 1.0:
            # Rounded once: 70 ms are 0.07 s.
            of = term.of * pc.scalar(factor) if factor > 1 else term.of / pc.scalar(1 / factor)
            term = Term(term.kind, of, term.said)
        self.asked[name] = term
        return term


def _known(truth: pc.Expression) -> pc.Expression:
    """False where it is not known."""
    return pc.coalesce(truth, pc.scalar(False))


def _column(name: str, its: pa.DataType) -> Term | None:
    """A column as a term; None where it has lists or the like."""
    of = pc.field(name)
    if pa.types.is_dictionary(its):
        return _column(name, its.value_type)
    if pa.types.is_boolean(its):
        return Term("true or false", of, name)
    if pa.types.is_string(its) or pa.types.is_large_string(its):
        return Term("text", of.cast(pa.string()), name)
    if pa.types.is_integer(its) or pa.types.is_floating(its) or pa.types.is_null(its):
        return Term("a number", of.cast(pa.float64(), safe=False), name)
    return None
