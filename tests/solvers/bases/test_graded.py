"""Graded dyadic knots against what they promise, and their transform against the uniform one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solvers.bases.graded import FINEST, GradedKnots, GradedWavelets
from solvers.bases.spline_wavelet import SplineWaveletBasis


@st.composite
def meshes(draw: st.DrawFn) -> GradedKnots:
    mesh = GradedKnots.uniform(draw(st.integers(5, 9)), draw(st.integers(0, 2)))
    for _ in range(draw(st.integers(1, 3))):
        change = draw(st.lists(st.integers(-2, 2), min_size=mesh.intervals, max_size=mesh.intervals))
        mesh = mesh.adapted(np.clip(mesh.levels + np.array(change), 0, 9))
    return mesh


def layers() -> GradedKnots:
    """Fine at both ends and in the middle, down to the finest level there is."""
    mesh = GradedKnots.uniform(8, 2)
    wanted = np.zeros(mesh.intervals, np.int64)
    wanted[[0, 16, -1]] = 3
    for level in range(4, FINEST + 1):
        mesh = mesh.adapted(wanted)
        wanted = mesh.levels.copy()
        wanted[[0, -1]] = level
    return mesh.adapted(wanted)


@given(meshes())
def test_neighbours_differ_by_a_factor_of_two_at_most_and_splits_tell_the_mesh(mesh: GradedKnots) -> None:
    widths = np.diff(mesh.knots)
    np.testing.assert_allclose(widths, 2.0**-mesh.levels / mesh.L, rtol=1e-9)
    assert np.all(np.abs(np.diff(mesh.levels)) <= 1)
    again = GradedKnots.from_active(mesh.L, [indices.tolist() for indices in mesh.active])
    np.testing.assert_array_equal(again.levels, mesh.levels)
    assert mesh.dimension == mesh.L + 3 + sum(indices.size for indices in mesh.active)
    assert mesh.full == 2**mesh.finest * mesh.L + 3


@given(meshes(), st.integers(0, 2**32 - 1))
def test_an_adapted_mesh_is_as_fine_as_asked_everywhere(mesh: GradedKnots, seed: int) -> None:
    wanted = np.random.default_rng(seed).integers(0, 7, mesh.intervals)
    finer = mesh.adapted(wanted)
    middles = (mesh.knots[1:] + mesh.knots[:-1]) / 2.0
    there = finer.levels[np.searchsorted(finer.knots, middles) - 1]
    assert np.all(there >= wanted)


def test_what_nobody_wants_fine_is_joined_to_the_roots() -> None:
    mesh = layers()
    coarse = mesh.adapted(np.zeros(mesh.intervals, np.int64))
    np.testing.assert_array_equal(coarse.levels, np.zeros(8))


def test_towards_a_place_the_mesh_gets_fine_there_alone() -> None:
    mesh = GradedKnots.uniform(8, 3).towards(0.3, 20)
    middles, widths = (mesh.knots[1:] + mesh.knots[:-1]) / 2, np.diff(mesh.knots)
    assert mesh.levels[np.searchsorted(mesh.knots, 0.3) - 1] == 20
    assert mesh.intervals < 64 + 6 * 17
    assert np.all(widths <= 2 * np.maximum(np.abs(middles - 0.3), 2.0**-23))
    assert mesh.towards(0.3, 12) is mesh


def test_knots_of_nested_meshes_are_equal_to_the_last_bit() -> None:
    mesh = layers()
    assert np.isin(GradedKnots.uniform(8, 0).knots, mesh.knots).all()
    sevenths = GradedKnots.uniform(7, 3)
    assert np.isin(sevenths.knots, sevenths.adapted(sevenths.levels + 5).knots).all()


def test_twenty_levels_at_two_ends_cost_a_few_functions() -> None:
    mesh = layers()
    assert mesh.finest == FINEST
    assert mesh.dimension < 150
    assert mesh.full == 2**20 * 8 + 3


@pytest.mark.parametrize("levels", [[0, 0, 0, 0], [1, 0, 1, 0, 0, 0], [0, 0, 0, 0, 2, 2, 2, 2]])
def test_what_is_no_graded_partition_is_refused(levels: list[int]) -> None:
    with pytest.raises(ValueError, match="graded dyadic"):
        GradedKnots(5, np.array(levels))


@pytest.mark.parametrize(("L", "J"), [(5, 0), (5, 1), (5, 3), (6, 2), (8, 4), (11, 3)])
def test_on_uniform_knots_the_coefficients_are_those_of_all_wavelets(L: int, J: int) -> None:
    graded, uniform = GradedWavelets(GradedKnots.uniform(L, J)), SplineWaveletBasis(L, J)
    splines = np.random.default_rng(J).normal(size=(uniform.dimension, 2))
    wavelets = graded.from_spline(splines)
    np.testing.assert_allclose(wavelets, uniform.from_spline(splines), rtol=0, atol=1e-13)
    np.testing.assert_allclose(graded.to_spline(wavelets), splines, rtol=0, atol=1e-13)
    assert graded.order == uniform.order


@given(meshes())
def test_the_way_back_is_exact(mesh: GradedKnots) -> None:
    wavelets = GradedWavelets(mesh)
    splines = np.sin(np.arange(mesh.dimension) ** 2)
    np.testing.assert_allclose(wavelets.to_spline(wavelets.from_spline(splines)), splines, rtol=0, atol=1e-12)
    assert sum(wavelets.sizes) == mesh.dimension


def test_the_way_back_is_exact_over_all_twenty_levels() -> None:
    wavelets = GradedWavelets(layers())
    space = wavelets.spline
    layer = np.exp(-1e5 * space.interpolation_points) + np.exp(-1e6 * (1 - space.interpolation_points))
    splines = space.interpolate(layer)
    np.testing.assert_allclose(wavelets.to_spline(wavelets.from_spline(splines)), splines, rtol=0, atol=1e-13)


def test_coefficients_of_a_smooth_function_fall_by_sixteen_from_level_to_level() -> None:
    """Cubic splines: the fourth derivative times the fourth power of the step."""
    mesh = GradedKnots.uniform(8, 4)
    wavelets = GradedWavelets(mesh)
    space = wavelets.spline
    found = wavelets.from_spline(space.interpolate(np.sin(7 * space.interpolation_points)))
    sizes = [np.abs(part).max() for part in np.split(found, np.cumsum(wavelets.sizes)[:-1])][1:]
    np.testing.assert_allclose(np.log2(np.array(sizes[:-1]) / sizes[1:])[1:], 4.0, atol=0.3)
