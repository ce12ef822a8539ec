"""Graphs and kernels against the expressions that they were made of."""

from __future__ import annotations

import numpy as np
import pytest

from solvers.arrays.compiled import CompiledKernel
from solvers.arrays.graph import Graph, GraphBackend
from solvers.arrays.kernel import Kernels, MakeKernel, NumpyKernel, fastest_kernel
from solvers.arrays.structure import affine, degree, depends_on
from solvers.backends import NUMPY
from solvers.expressions import parse

KERNELS = [NumpyKernel, CompiledKernel]
NAMES = ("x", "y", "z")
TEXTS = [
    "x",
    "3.5",
    "x - (-y)",
    "-x*y + 0*z",
    "(x + y)*(y + x)/(x + y)",
    "x^2 - y^3 + z^4 - x^0.5",
    "2^x + x^y - x^-2",
    "1/(1 - x) - (x + 0)*1",
    "sin(x)*cos(x) + atan2(y, x) - min(x, y, z) + max(x, 2) + abs(y - z)",
    "exp(-x) + log(x) + sqrt(y) + sign(x - y) + tanh(z)*sinh(x) - cosh(y) + asin(x/9) + acos(x/9)",
]


def graph_of(*texts: str) -> list:
    graph = Graph()
    scope = {name: graph.input(name) for name in NAMES}
    return [graph.symbol(parse(text).evaluate(scope, GraphBackend(graph).functions)) for text in texts]


@pytest.mark.parametrize("make", KERNELS)
@pytest.mark.parametrize("text", TEXTS)
def test_a_kernel_gives_what_the_expression_gives(make: MakeKernel, text: str) -> None:
    values = np.random.default_rng(1).uniform(0.1, 3.0, (3, 600))
    (symbol,) = graph_of(text)
    kernel = make([symbol], NAMES, 600)
    kernel.inputs[:] = values
    kernel.run()
    expected = parse(text).evaluate(dict(zip(NAMES, values, strict=True)))
    np.testing.assert_allclose(kernel.outputs[0], np.broadcast_to(expected, 600), rtol=1e-13)


@pytest.mark.parametrize("make", KERNELS)
def test_values_that_use_each_other_keep_apart(make: MakeKernel) -> None:
    """Arrays are used again; an output that is also an operand, or stands twice, must survive."""
    texts = ["x*y", "x*y + sin(x*y)", "x*y", "y", "2", "sin(x*y)*(x*y + sin(x*y))"]
    kernels = Kernels(graph_of(*texts), NAMES, make)
    for places in (7, 3, 7):
        kernel = kernels.at(places)
        kernel.inputs[:] = np.random.default_rng(places).normal(size=(3, places))
        kernel.run()
        scope = dict(zip(NAMES, kernel.inputs, strict=True))
        expected = [np.broadcast_to(parse(text).evaluate(scope), places) for text in texts]
        np.testing.assert_allclose(kernel.outputs, expected, rtol=1e-14)


def test_equal_subexpressions_are_one_node() -> None:
    first, second = graph_of("sin(x + y)*2", "2*sin(y + x)")
    assert first.place == second.place
    assert len(first.graph.nodes) == len(graph_of("sin(x + y)*2")[0].graph.nodes)


@pytest.mark.parametrize(
    ("text", "names", "expected"),
    [
        ("2*x - y/4 + 1", "xyz", 1),
        ("x*y + z", "xyz", 2),
        ("x*y + z", "x", 1),
        ("sin(z)*x^2", "x", 2),
        ("sin(z)*x^2", "xz", np.inf),
        ("x/y", "y", np.inf),
        ("x/y", "x", 1),
        ("3 + cos(2)", "xyz", 0),
        ("abs(x)", "x", np.inf),
    ],
)
def test_degree(text: str, names: str, expected: float) -> None:
    assert degree(graph_of(text)[0], names) == expected


def test_affine_values_tell_their_factors() -> None:
    slopes = affine(graph_of("2*(x - 3*y) + 5 - y/2")[0])
    assert slopes == {"x": pytest.approx(2), "y": pytest.approx(-6.5), "": pytest.approx(5)}
    assert affine(graph_of("x*y")[0]) is None


def test_dependences_see_through_what_is_cancelled_by_constants() -> None:
    assert depends_on(graph_of("x + 0*y", "sin(z)")) == {"x", "z"}


@pytest.mark.parametrize("size", [1, 2, 5])
def test_linear_systems_are_solved(size: int) -> None:
    random = np.random.default_rng(size)
    factor = random.normal(size=(size, size))
    matrix, right = factor @ factor.T + np.eye(size), random.normal(size=size)
    graph = Graph()
    backend = GraphBackend(graph)
    entries = [[graph.input(f"a{i}{j}") for j in range(size)] for i in range(size)]
    loads = [graph.input(f"b{i}") for i in range(size)]
    names = [f"a{i}{j}" for i in range(size) for j in range(size)] + [f"b{i}" for i in range(size)]
    kernel = NumpyKernel(backend.solve(entries, loads), names, 1)
    kernel.inputs[:, 0] = [*matrix.ravel(), *right]
    kernel.run()
    np.testing.assert_allclose(kernel.outputs[:, 0], np.linalg.solve(matrix, right), rtol=1e-10)


def test_a_zero_on_the_diagonal_is_exchanged() -> None:
    backend = GraphBackend(Graph())
    x, y = backend.solve([[0.0, 2.0], [4.0, 1.0]], [2.0, 9.0])
    kernel = NumpyKernel([x, y], [], 1)
    kernel.run()
    expected = NUMPY.solve([[0.0, 2.0], [4.0, 1.0]], [2.0, 9.0])
    np.testing.assert_allclose(kernel.outputs[:, 0], expected)


@pytest.mark.parametrize("largest", [1.0, 1e3, 9e4, 1e7, 1e300])
def test_compiled_sines_of_angles_of_any_size(largest: float) -> None:
    angles = np.random.default_rng(3).uniform(-largest, largest, 2000)
    angles[:8] = np.arange(-4, 4) * np.pi / 2
    kernel = CompiledKernel(graph_of("sin(x)", "cos(x)"), NAMES, 2000)
    kernel.inputs[0] = angles
    kernel.run()
    np.testing.assert_allclose(kernel.outputs, [np.sin(angles), np.cos(angles)], atol=1e-15, rtol=0)


def test_compiled_values_that_are_not_numbers() -> None:
    kernel = CompiledKernel(graph_of("sin(x)", "cos(x)", "sqrt(x)", "1/x", "min(x, 1)"), NAMES, 4)
    kernel.inputs[0] = [np.nan, np.inf, -1.0, 0.0]
    kernel.run()
    with np.errstate(all="ignore"):
        x = kernel.inputs[0]
        expected = [np.sin(x), np.cos(x), np.sqrt(x), 1 / x, np.minimum(x, 1)]
    np.testing.assert_allclose(kernel.outputs, expected, atol=1e-15)


def test_the_fastest_kernel_is_the_compiled_one_where_numba_is(monkeypatch: pytest.MonkeyPatch) -> None:
    fastest_kernel.cache_clear()
    assert fastest_kernel() is CompiledKernel
    fastest_kernel.cache_clear()
    monkeypatch.setattr("solvers.arrays.kernel.find_spec", lambda name: None)
    assert fastest_kernel() is NumpyKernel
    fastest_kernel.cache_clear()
