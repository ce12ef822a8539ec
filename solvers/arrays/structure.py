"""What a graph shows of its values: which inputs they depend on, and whether linearly."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import inf

from solvers.arrays.graph import Graph, Symbol, needed


def dependences(graph: Graph) -> list[frozenset[str]]:
    """The inputs on which each node depends."""
    found: list[frozenset[str]] = []
    for node in graph.nodes:
        names = {node.name} if node.operation == "input" else set()
        found.append(frozenset(names.union(*[found[place] for place in node.operands])))
    return found


def depends_on(symbols: Sequence[Symbol]) -> frozenset[str]:
    """The inputs on which any of these values depends."""
    if not symbols:
        return frozenset()
    found = dependences(symbols[0].graph)
    return frozenset().union(*[found[symbol.place] for symbol in symbols])


def degree(symbol: Symbol, names: Collection[str]) -> float:
    """The degree of a value as a polynomial in these inputs; infinite where it is none.

    Other inputs count as constants.
    """
    degrees: list[float] = []
    for node in symbol.graph.nodes[: symbol.place + 1]:
        below = [degrees[place] for place in node.operands]
        match node.operation:
            case "input":
                degrees.append(1.0 if node.name in names else 0.0)
            case "add" | "subtract" | "negative":
                degrees.append(max(below))
            case "multiply":
                degrees.append(below[0] + below[1])
            case "divide":
                degrees.append(below[0] if below[1] == 0.0 else inf)
            case _:
                degrees.append(0.0 if max(below, default=0.0) == 0.0 else inf)
    return degrees[symbol.place]


def affine(symbol: Symbol) -> Mapping[str, float] | None:
    """The factor of each input, that of "" the constant; None where a value is not linear in its inputs."""
    inputs = sorted(depends_on([symbol]))
    if degree(symbol, inputs) > 1.0:
        return None
    constant = value_at(symbol, dict.fromkeys(inputs, 0.0))
    slopes = {
        name: value_at(symbol, {other: float(other == name) for other in inputs}) - constant
        for name in inputs
    }
    return {**slopes, "": constant}


def value_at(symbol: Symbol, inputs: Mapping[str, float]) -> float:
    """The value at these inputs."""
    values: dict[int, float] = {}
    for place in needed(symbol.graph, [symbol]):
        node = symbol.graph.nodes[place]
        if node.operation == "input":
            values[place] = inputs.get(node.name, 0.0)
        elif node.operation == "constant":
            values[place] = node.value
        else:
            values[place] = float(node(*[values[below] for below in node.operands]))
    return values[symbol.place]
