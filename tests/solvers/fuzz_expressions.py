"""Feeds the parser of expressions with noise; run as a process of little memory by its test.

Prints the number of texts that were taken and refused. Whatever else happens (another exception, no memory,
no time) ends the process with an error.
"""

from __future__ import annotations

import random
import resource
import sys
import time

import numpy as np

from solvers.errors import ExpressionError
from solvers.expressions import parse

MEMORY = 128 * 2**20
"""What may be allocated beyond what the interpreter has when it starts, in bytes."""

SLOWEST = 0.5
"""Seconds of processor time that one text may take."""

PLAIN = "0 1 9 1e308 1e400 .5 5. 1e 1e+ 0x1 1_0 a b_dot t pi deg tf é λ \u0663 _ __class__"
SIGNS = "+ - * / ^ ** ( ) , . : ; = == < > ! & | % @ # $ [ ] { } ' \" \\ ` ~ ?"
CALLS = "sin( cos( atan2( min( max( abs( exp( lambda import eval( if else and not"
ODD = (" ", "\n", "\t", "\0", "\ufeff", "\u202e", "\ud800", "\U0001f600")
PIECES = (*" ".join((PLAIN, SIGNS, CALLS)).split(" "), *ODD)
HEAVIEST = "- ( sin( a+ a^ 2** (( -( 1/ min(a, 9 a . e é a*(b+"
HEAVY = (*HEAVIEST.split(" "), " ", "\t")
GOOD = (
    "Jb + 2*m*(R^2 + L^2 + 2*R*L*cos(alpha))",
    "-a^2 + 2^-1",
    "min(a, b, max(c, d))",
    "atan2(y, x)/pi",
)


def texts(count: int, seed: int) -> list[str]:
    """Texts of every kind: pieces in a row, good ones spoiled, one piece very often."""
    choose = random.Random(seed)
    made = [piece * (times // len(piece)) for piece in HEAVY for times in (63, 4096, 100_000, 1_000_000)]
    while len(made) < count:
        kind = choose.random()
        if kind < 0.5:
            made.append("".join(choose.choices(PIECES, k=choose.randint(1, 40))))
        elif kind < 0.9:
            text = list(choose.choice(GOOD))
            for _ in range(choose.randint(0, 4)):
                text[choose.randrange(len(text))] = choose.choice(PIECES)
            made.append("".join(text))
        else:
            made.append(choose.choice(HEAVY) * choose.randint(1, 2000) + choose.choice(PIECES))
    return made


def main(count: int, seed: int) -> None:
    """Parse them all, and evaluate those that are good."""
    pages = int(open("/proc/self/statm").read().split()[0])  # noqa: SIM115
    limit = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    taken = refused = 0
    for text in texts(count, seed):
        began = time.process_time()
        try:
            expression = parse(text)
        except ExpressionError as error:
            inside = 0 <= error.position <= len(text)
            refused += 1
        else:
            with np.errstate(all="ignore"):
                values = dict.fromkeys(expression.names, np.full(3, 0.5))
                if not expression.called:  # what is called must be a data table
                    expression.evaluate(values)
            inside = True
            taken += 1
        assert inside, text[:80]
        assert time.process_time() - began < SLOWEST, text[:80]
    print(taken, refused)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
