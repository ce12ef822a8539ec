"""The operators of the paper do what its section 4 says, each by itself."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from solvers.optimizers.genetic import ClassicOperators, Draw, Generation

COUNT, SIZE = 7, 5
# Every gene tells whose it is: ten times its row, plus its place.
GENES = 10.0 * np.arange(COUNT)[:, None] + np.arange(SIZE)


def drawn(operators: ClassicOperators, generations: int, size: int = SIZE) -> list[Draw]:
    draws = operators.draws(COUNT, size, np.random.default_rng(0))
    return [next(draws) for _ in range(generations)]


def test_parents_are_drawn_with_chances_proportional_to_the_inverse_of_their_objectives() -> None:
    fitness = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, np.inf])
    parents = Generation(GENES, fitness)
    draws = drawn(ClassicOperators(0.0, 0.0, 0.0, 0), 6000)
    rows = np.concatenate([draw.children(parents)[:, 0] // 10 for draw in draws]).astype(int)
    expected = 1.0 / fitness
    np.testing.assert_allclose(
        np.bincount(rows, minlength=COUNT) / rows.size, expected / expected.sum(), atol=8e-3
    )


def test_consecutive_pairs_exchange_what_is_behind_one_place() -> None:
    parents = Generation(GENES, np.ones(COUNT))
    crossings = 0
    for draw in drawn(ClassicOperators(0.9, 0.0, 0.0, 0), 500):
        chosen = parents.genes[(draw.turns * COUNT).astype(int)]
        children = draw.children(parents)
        np.testing.assert_array_equal(children[-1], chosen[-1])  # an odd one has no partner
        for first in range(0, COUNT - 1, 2):
            a, b = chosen[first], chosen[first + 1]
            exchanged = [k for k in range(SIZE) if draw.sources[first, k] // SIZE != first]
            place = min(exchanged, default=SIZE)
            assert place > 0
            np.testing.assert_array_equal(children[first], [*a[:place], *b[place:]])
            np.testing.assert_array_equal(children[first + 1], [*b[:place], *a[place:]])
            crossings += place < SIZE
    assert crossings / 1500 == pytest.approx(0.9, abs=0.03)


def test_genes_are_moved_by_normal_numbers_with_the_probability_of_mutation() -> None:
    moves = np.array([draw.moves for draw in drawn(ClassicOperators(0.9, 0.1, 0.3, 0), 5000)])
    moved = moves[moves != 0.0]
    assert moved.size / moves.size == pytest.approx(0.1, abs=3e-3)
    assert np.std(moved) == pytest.approx(0.3, rel=0.02)
    assert np.mean(moved) == pytest.approx(0.0, abs=6e-3)


@pytest.mark.parametrize("elite", [0, 1, 3])
def test_so_many_of_the_best_survive_unchanged(elite: int) -> None:
    generations: list[Generation] = []
    ClassicOperators(0.9, 1.0, 1.0, elite).evolve(
        lambda genes: 1.0 + (genes**2).sum(axis=1), GENES, 30, np.random.default_rng(1), generations.append
    )
    assert len(generations) == 31
    for before, now in pairwise(generations):
        kept = np.argsort(before.fitness)[:elite]
        assert {tuple(before.genes[k]) for k in kept} <= {tuple(row) for row in now.genes}


def test_a_longer_run_begins_as_a_shorter_one() -> None:
    operators = ClassicOperators(0.9, 0.1, 1.0, 1)
    ends = []
    for generations in (20, 50):
        seen: list[Generation] = []
        operators.evolve(
            lambda genes: 1.0 + (genes**2).sum(axis=1),
            GENES,
            generations,
            np.random.default_rng(2),
            seen.append,
        )
        ends.append(seen[20].genes)
    np.testing.assert_array_equal(*ends)
