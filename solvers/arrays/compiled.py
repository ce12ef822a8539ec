"""Runs a graph over arrays by one compiled loop over its operations: an interpreter, made by numba.

Optional (``pip install ondelette[numba]``). What is compiled is this file, once, and kept on disk; graphs are
data to it, so that nothing submitted is ever compiled. Sine and cosine, where populations spend their time,
are one polynomial that the compiler can run on several numbers at once (Shibata and Petrogalli, "SLEEF", IEEE
Trans. Parallel Distrib. Syst. 31, 2020; reduction by Cody and Waite), within two units of the last place.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, sin

import numba
import numpy as np
from numpy.typing import NDArray

from solvers.arrays.graph import OPERATIONS, Symbol, needed

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

CODES = {name: code for code, name in enumerate(OPERATIONS)}
_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _NEGATIVE, _POWER = range(6)
_SIN, _COS, _TAN, _ASIN, _ACOS, _ATAN, _ATAN2 = (
    CODES[name] for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2")
)
_SINH, _COSH, _TANH, _EXP, _LOG, _SQRT, _ABS, _SIGN, _MIN, _MAX = (
    CODES[name] for name in ("sinh", "cosh", "tanh", "exp", "log", "sqrt", "abs", "sign", "min", "max")
)
_COPY = len(CODES)
# Places that are gone through together, so that what is between inputs and outputs stays in the cache.
_BLOCK = 512
# Up to here the reduction of angles is exact enough.
_LARGEST_ANGLE = 1e5
_HALF_TURNS = 1.0 / np.pi
# pi in three parts, the first two short enough for exact products with whole numbers.
_PI = (3.14159250259399414062e0, 1.50995788317231927067e-7, 1.07806057163162381158e-14)
_SINE = (
    -7.97255955009037868891952e-18,
    2.81009972710863200091251e-15,
    -7.64712219118158833288484e-13,
    1.60590430605664501629054e-10,
    -2.50521083763502045810755e-8,
    2.75573192239198747630416e-6,
    -1.98412698412696162806809e-4,
    8.33333333333332974823815e-3,
    -1.66666666666666657414808e-1,
)


class CompiledKernel:
    """Like :class:`solvers.arrays.kernel.NumpyKernel`.

    Inputs and outputs are rows of one table (rows, K); everything between them, and constants, are rows of
    another one that is as long as a block.
    """

    def __init__(self, outputs: Sequence[Symbol], names: Sequence[str], places: int) -> None:
        rows = {name: row for row, name in enumerate(names)}
        steps, constants, size = _allocated(outputs, rows)
        whole = len(rows) + len(outputs)
        table = np.zeros((whole, places))
        between = np.zeros((size - whole, min(places, _BLOCK)))
        for row, value in constants.items():
            (table[row] if row < whole else between[row - whole])[:] = value
        self.inputs: Vector = table[: len(rows)]
        self.outputs: Vector = table[len(rows) :]
        self._arguments = (*np.array(steps, np.int64).reshape(-1, 4).T.copy(), table, between)

    def run(self) -> None:
        """Evaluate everything."""
        _interpret(*self._arguments)


def _allocated(
    outputs: Sequence[Symbol], inputs: dict[str, int]
) -> tuple[list[tuple[int, int, int, int]], dict[int, float], int]:
    """Steps (code, first, second, target), rows of constants, number of rows: inputs first, then outputs."""
    graph = outputs[0].graph
    order = needed(graph, outputs)
    last = {operand: place for place in order for operand in graph.nodes[place].operands}
    wanted = {symbol.place: len(inputs) + row for row, symbol in reversed(list(enumerate(outputs)))}
    size = len(inputs) + len(outputs)
    held: dict[int, int] = {}
    free: list[int] = []
    constants: dict[int, float] = {}
    steps = []
    for place in order:
        node = graph.nodes[place]
        if node.operation == "input":
            held[place] = inputs[node.name]
            continue
        target = wanted.get(place)
        if node.operation == "constant":
            if target is None:
                target, size = size, size + 1
            constants[target] = node.value
        else:
            rows = [held[operand] for operand in node.operands]
            # Not into the row of an operand: what may overlap is not done several numbers at once.
            if target is None:
                target = free.pop() if free else size
                size = max(size, target + 1)
            for operand in set(node.operands):
                if last[operand] == place and operand not in wanted and graph.nodes[operand].operands:
                    free.append(held[operand])
            steps.append((CODES[node.operation], rows[0], rows[-1], target))
        held[place] = target
    for row, symbol in enumerate(outputs):
        if held[symbol.place] != len(inputs) + row:
            steps.append((_COPY, held[symbol.place], held[symbol.place], len(inputs) + row))
    return steps, constants, size


@numba.njit(cache=True, fastmath={"contract"}, error_model="numpy")
def _turn(angles: Vector, turn: float, out: Vector) -> None:
    """sin(angle + turn pi/2) of every angle, for a turn of 0 or 1: reduced to half a turn, then a polynomial.

    Arithmetic in place of choices, which would keep the compiler from taking several numbers at once.
    """
    shift = 0.5 * turn
    for k in range(angles.size):
        x = angles[k]
        half_turns = np.floor(x * _HALF_TURNS + shift + 0.5)
        own = half_turns - shift
        r = ((x - own * _PI[0]) - own * _PI[1]) - own * _PI[2]
        z = r * r
        s = _SINE[0]
        for term in range(1, 9):
            s = s * z + _SINE[term]
        pairs = 0.5 * half_turns
        sign = 1.0 - 4.0 * (pairs - np.floor(pairs))
        out[k] = sign * (r + r * z * s)


@numba.njit(cache=True, error_model="numpy")
def _turn_far(angles: Vector, turn: float, out: Vector) -> None:
    """The same by the library, for angles so large that the reduction would lose digits."""
    for k in range(angles.size):
        out[k] = sin(angles[k]) if turn == 0.0 else cos(angles[k])


@numba.njit(cache=True, fastmath={"nnan", "nsz", "reassoc"}, error_model="numpy")
def _largest(values: Vector) -> float:
    """The largest magnitude; NaN counts for nothing."""
    largest = 0.0
    for k in range(values.size):
        largest = max(largest, abs(values[k]))
    return largest


@numba.njit(cache=True, error_model="numpy")
def _row(table: Vector, between: Vector, row: int, start: int, stop: int) -> Vector:
    """The values of a row at the places of a block."""
    if row < table.shape[0]:
        return table[row, start:stop]
    return between[row - table.shape[0], : stop - start]


@numba.njit(cache=True, fastmath={"contract"}, error_model="numpy")
def _interpret(
    codes: Indices, first: Indices, second: Indices, targets: Indices, table: Vector, between: Vector
) -> None:
    """Do every step, block of places after block."""
    for start in range(0, table.shape[1], _BLOCK):
        stop = min(start + _BLOCK, table.shape[1])
        for step in range(codes.size):
            a = _row(table, between, first[step], start, stop)
            b = _row(table, between, second[step], start, stop)
            out = _row(table, between, targets[step], start, stop)
            _do(codes[step], a, b, out)


@numba.njit(cache=True, fastmath={"contract"}, error_model="numpy")
def _do(code: int, a: Vector, b: Vector, out: Vector) -> None:
    """One operation."""
    if code == _ADD:
        for k in range(out.size):
            out[k] = a[k] + b[k]
    elif code == _SUBTRACT:
        for k in range(out.size):
            out[k] = a[k] - b[k]
    elif code == _MULTIPLY:
        for k in range(out.size):
            out[k] = a[k] * b[k]
    elif code == _DIVIDE:
        for k in range(out.size):
            out[k] = a[k] / b[k]
    elif code == _NEGATIVE:
        for k in range(out.size):
            out[k] = -a[k]
    elif code in (_SIN, _COS):
        turn = 0.0 if code == _SIN else 1.0
        if _largest(a) <= _LARGEST_ANGLE:
            _turn(a, turn, out)
        else:
            _turn_far(a, turn, out)
    elif code == _SQRT:
        for k in range(out.size):
            out[k] = np.sqrt(a[k])
    elif code == _ABS:
        for k in range(out.size):
            out[k] = abs(a[k])
    elif code == _MIN:
        out[:] = np.minimum(a, b)
    elif code == _MAX:
        out[:] = np.maximum(a, b)
    elif code == _POWER:
        out[:] = a**b
    elif code == _ATAN2:
        for k in range(out.size):
            out[k] = atan2(a[k], b[k])
    elif code == _COPY:
        out[:] = a
    else:
        _call(code, a, out)


@numba.njit(cache=True, error_model="numpy")
def _call(code: int, a: Vector, out: Vector) -> None:
    """One of the functions that are seldom used."""
    if code == _TAN:
        out[:] = np.tan(a)
    elif code == _ASIN:
        out[:] = np.arcsin(a)
    elif code == _ACOS:
        out[:] = np.arccos(a)
    elif code == _ATAN:
        out[:] = np.arctan(a)
    elif code == _SINH:
        out[:] = np.sinh(a)
    elif code == _COSH:
        out[:] = np.cosh(a)
    elif code == _TANH:
        out[:] = np.tanh(a)
    elif code == _EXP:
        out[:] = np.exp(a)
    elif code == _LOG:
        out[:] = np.log(a)
    elif code == _SIGN:
        out[:] = np.sign(a)
