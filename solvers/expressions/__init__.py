"""The expression language of job documents: read once, evaluated over floats, NumPy arrays or symbols.

Own tokenizer and Pratt parser; what is read is never handed to Python's ``eval`` or ``ast``.
"""

from solvers.expressions.compose import (
    applied,
    combined,
    named,
    operand_of,
    operands_of,
    part_of,
    positive_part,
    product,
    renamed,
    total,
    without,
)
from solvers.expressions.expression import Code, Expression
from solvers.expressions.parser import (
    MAX_CHARACTERS,
    MAX_DEPTH,
    MAX_OPERATIONS,
    ExpressionLimitError,
    parse,
    unknown_function,
)
from solvers.expressions.vocabulary import (
    CONSTANTS,
    FUNCTIONS,
    LOOKUP,
    NUMPY_FUNCTIONS,
    RESERVED,
    did_you_mean,
    quoted,
)

__all__ = [
    "CONSTANTS",
    "FUNCTIONS",
    "LOOKUP",
    "MAX_CHARACTERS",
    "MAX_DEPTH",
    "MAX_OPERATIONS",
    "NUMPY_FUNCTIONS",
    "RESERVED",
    "Code",
    "Expression",
    "ExpressionLimitError",
    "applied",
    "combined",
    "did_you_mean",
    "named",
    "operand_of",
    "operands_of",
    "parse",
    "part_of",
    "positive_part",
    "product",
    "quoted",
    "renamed",
    "total",
    "unknown_function",
    "without",
]
