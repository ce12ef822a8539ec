"""Simulated populations against an independent integration of the model, whatever way the model allows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solvers.arrays.compiled import CompiledKernel
from solvers.arrays.kernel import NumpyKernel
from solvers.arrays.structure import depends_on
from solvers.backends import NUMPY
from solvers.bases.daubechies import DaubechiesBasis
from solvers.catalogue import load_case
from solvers.formulation.stated import stated_problem
from solvers.genetic.fitness import Fitness
from solvers.genetic.genome import Genome
from solvers.genetic.model import ArrayModel
from solvers.genetic.quadrature import QuadratureSimulator, find_chains
from solvers.genetic.runge_kutta import RungeKuttaSimulator
from solvers.genetic.simulators import simulator_of
from solvers.genetic.stage import Stages
from solvers.spec import GeneticMethod, check_document
from solvers.start.scaling import automatic_scaling


def model_of(document: dict[str, Any]) -> ArrayModel:
    return ArrayModel(stated_problem(check_document(document).problem))


def genome_of(model: ArrayModel, basis: DaubechiesBasis) -> Genome:
    return Genome(model.problem, automatic_scaling(model.problem), basis, model.problem.guess)


def population(genome: Genome, count: int, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return genome.first() + random.standard_normal((count, genome.size))


def chain(**changes: Any) -> dict[str, Any]:
    """Two integrators, a state that follows, an integral with a window, and a rate that names the time."""
    return {
        "problem": {
            "model": {
                "kind": "first_order",
                "states": ["v", "x", "w", "q"],
                "controls": ["a", "b"],
                "dynamics": {"x": "3*v + 1", "v": "2*a - b", "w": "x - v + b", "q": "sin(x)*a + t*v^2 - b"},
            },
            "initial_time": 1,
            "final_time": 3,
            "initial_state": {"v": 0.5, "x": 1, "w": 0, "q": 2},
            "final_state": {"x": 4, "q": [None, 3]},
            "objective": {"running": "a^2 + a*b + 2*b^2 + b + 1", "terminal": "w_f"},
            "integrals": [{"name": "effort", "expression": "v*a + q*0", "bounds": [None, 1]}],
            "path_constraints": [{"expression": "x + b", "bounds": [None, 2], "during": [0.25, 0.5]}],
            "bounds": {"a": [-1, 1]},
        }
        | changes
    }


def flown(
    model: ArrayModel, basis: DaubechiesBasis, coefficients: np.ndarray, times: tuple, start: Any
) -> Any:
    """SciPy's integration under the exact control on dyadic points, linear between them."""
    level = 11
    tau, table = basis.points(level), coefficients @ basis.values(level)
    problem = model.problem
    knots = times[0] + (times[1] - times[0]) * tau

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        u = [np.interp(t, knots, row) for row in table]
        rates = problem.rate(list(x), u, t, problem.parameters, NUMPY)
        return np.array([float(value) for value in rates])

    step = (knots[-1] - knots[0]) / 320
    return solve_ivp(rate, times, start, rtol=1e-8, atol=1e-9, max_step=step).y[:, -1]


def test_chains_are_told_from_the_expressions() -> None:
    chains = find_chains(model_of(chain()))
    assert chains is not None
    assert list(chains.rates) == ["v", "x", "w"]
    assert chains.integrals == ("q",)
    assert chains.rates["x"] == {"v": 3.0, "": 1.0}


@pytest.mark.parametrize(
    "case", ["flexible_spacecraft", "van_der_pol", "hypersensitive", "brachistochrone", "goddard"]
)
def test_models_without_chains_are_not_taken_for_such(case: str) -> None:
    assert find_chains(model_of(load_case(case))) is None


def test_mechanical_models_have_chains_too(rigid_body: dict[str, Any]) -> None:
    chains = find_chains(model_of(rigid_body))
    assert chains is not None
    assert chains.rates == {"x_dot": {"u": 1.0, "": 0.0}, "x": {"x_dot": 1.0, "": 0.0}}


@pytest.mark.parametrize("levels", [0, 1])
@pytest.mark.parametrize("periodic", [True, False])
def test_quadrature_of_a_chain(levels: int, periodic: bool) -> None:
    model = model_of(chain())
    basis = DaubechiesBasis(2, 4, levels, periodic)
    genome = genome_of(model, basis)
    simulator = simulator_of(model, genome)
    assert isinstance(simulator, QuadratureSimulator)
    genes = 0.5 * population(genome, 3)
    individuals = genome.read(genes)
    simulated = simulator.simulate(individuals)
    for index, coefficients in enumerate(individuals.coefficients):
        expected = flown(model, basis, coefficients, (1.0, 3.0), [0.5, 1, 0, 2])
        np.testing.assert_allclose(simulated.final[:, index], expected, atol=2e-3)
    fine = QuadratureSimulator(model, genome, find_chains(model), 8).simulate(individuals)
    np.testing.assert_allclose(fine.final[:3], simulated.final[:3], atol=1e-7)  # chained: exact tables


def test_quadrature_and_runge_kutta_agree() -> None:
    """Two ways to everything: final states, cost, integrals, violation."""
    model = model_of(chain())
    genome = genome_of(model, DaubechiesBasis(2, 4, 1))
    individuals = genome.read(population(genome, 5))
    first = QuadratureSimulator(model, genome, find_chains(model), 9).simulate(individuals)
    second = RungeKuttaSimulator(model, genome, 8).simulate(individuals)
    np.testing.assert_allclose(first.final, second.final, atol=2e-5)
    np.testing.assert_allclose(first.cost, second.cost, rtol=1e-12)
    np.testing.assert_allclose(first.integrals, second.integrals, atol=2e-4)
    np.testing.assert_allclose(first.violation, second.violation, rtol=2e-3)
    assert np.all(first.violation > 0)


@pytest.fixture(scope="module")
def solar_array() -> Genome:
    return genome_of(model_of(load_case("solar_array_2")), DaubechiesBasis(2, 5))


def test_the_attitude_of_the_solar_array_on_80_intervals(solar_array: Genome) -> None:
    model = ArrayModel(solar_array.problem)
    individuals = solar_array.read(np.random.default_rng(0).standard_normal((300, 15)))
    search = simulator_of(model, solar_array)
    fine = QuadratureSimulator(model, solar_array, find_chains(model), 8)
    assert search._weights.size == 81
    turned, exact = (simulator.simulate(individuals).final[0] for simulator in (search, fine))
    assert np.abs(turned - exact).max() <= 1e-4


def test_compiled_populations_are_those_of_numpy(
    solar_array: Genome, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = ArrayModel(solar_array.problem)
    genes = population(solar_array, 48)
    found = []
    for kernel in (NumpyKernel, CompiledKernel):
        monkeypatch.setattr("solvers.arrays.kernel.fastest_kernel", lambda kernel=kernel: kernel)
        found.append(Fitness(model, solar_array, simulator_of(model, solar_array), 100.0)(genes))
    np.testing.assert_allclose(*found, rtol=1e-12)


def test_ends_that_are_linear_in_the_genes_are_met_by_all_that_is_searched(solar_array: Genome) -> None:
    method = GeneticMethod(name="ga")
    stage = Stages.of(solar_array.problem, solar_array.scaling, method, None).at(0)
    assert stage.coordinates.size == 15 - 3  # of four ends the attitude alone is not linear
    genes = stage.coordinates.genes(np.random.default_rng(0).standard_normal((20, 12)))
    final = stage.fitness.simulator.simulate(solar_array.read(genes)).final
    np.testing.assert_allclose(final[1:], np.array([[0.5], [1.0], [1.0]]) * np.pi * np.ones(20), atol=1e-12)
    assert np.ptp(final[0]) > 0.1
    for soft in ({"polish": "penalty"}, {"variant": "classic"}):
        other = Stages.of(solar_array.problem, solar_array.scaling, GeneticMethod(name="ga", **soft), None)
        assert other.at(0).coordinates.size == 15


def test_the_cost_of_a_quadratic_form_is_exact() -> None:
    model = model_of(chain())
    genome = genome_of(model, DaubechiesBasis(2, 4))
    individuals = genome.read(population(genome, 2))
    cost = simulator_of(model, genome).simulate(individuals).cost
    a, b = np.moveaxis(individuals.coefficients, 1, 0)
    by_hand = 2 * (((a**2 + a * b + 2 * b**2).sum(axis=1) + b.sum(axis=1)) / 4 + 1)
    np.testing.assert_allclose(cost, by_hand, rtol=1e-13)


def test_runge_kutta_on_a_model_that_needs_it(flexible_spacecraft: dict[str, Any]) -> None:
    model = model_of(flexible_spacecraft)
    basis = DaubechiesBasis(2, 8)
    genome = genome_of(model, basis)
    simulator = simulator_of(model, genome)
    assert isinstance(simulator, RungeKuttaSimulator)
    individuals = genome.read(population(genome, 4))
    assert np.unique(individuals.tf).size == 4  # the final time is one more gene
    simulated = simulator.simulate(individuals)
    for index in (0, 3):
        expected = flown(
            model, basis, individuals.coefficients[index], (0.0, individuals.tf[index]), np.zeros(4)
        )
        np.testing.assert_allclose(simulated.final[:, index], expected, atol=2e-4)


def test_runge_kutta_is_of_fourth_order(oscillator: dict[str, Any]) -> None:
    """A constant control: sum of all functions. x = 1 - cos(2), x' = sin(2)."""
    model = model_of(oscillator)
    errors = []
    for level in (1, 2, 3):
        genome = genome_of(model, DaubechiesBasis(2, 4))
        final = RungeKuttaSimulator(model, genome, level).simulate(genome.read(np.ones((1, 4)))).final
        errors.append(np.abs(final[:, 0] - [1 - np.cos(2), np.sin(2)]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.7)


def test_everything_free_becomes_genes_within_its_bounds(flexible_spacecraft: dict[str, Any]) -> None:
    problem = flexible_spacecraft["problem"]
    problem["initial_state"]["theta"] = [-0.1, 0.1]
    problem["design"] = {"k": {"bounds": [90, 110]}}
    model = model_of(flexible_spacecraft)
    genome = genome_of(model, DaubechiesBasis(2, 5))
    assert genome.size == 5 + 3
    assert not genome.fixed
    genes = np.zeros((2, 8))
    genes[1, 5:] = 50.0
    individuals = genome.read(genes)
    np.testing.assert_allclose(individuals.initial[0], [0.0, 0.1])
    np.testing.assert_allclose(individuals.design[0], [100.0, 110.0])
    np.testing.assert_allclose(individuals.tf, [30.0, 100.0])
    assert individuals.strayed[0] == 0.0
    assert individuals.strayed[1] > 1000.0
    assert {"k"} <= depends_on(model.rates)
    simulated = simulator_of(model, genome).simulate(genome.read(population(genome, 3)))
    assert np.isfinite(simulated.final).all()


def test_fitness_is_objective_plus_penalties() -> None:
    model = model_of(chain())
    genome = genome_of(model, DaubechiesBasis(2, 4))
    simulator = simulator_of(model, genome)
    genes = population(genome, 4)
    fitness = Fitness(model, genome, simulator, 7.0)
    found, simulated = fitness.evaluate(genes), simulator.simulate(genome.read(genes))
    np.testing.assert_allclose(found.objective, simulated.cost + simulated.final[2])
    residuals = np.array(
        [
            simulated.final[1] - 4,
            np.maximum(0, simulated.final[3] - 3),
            np.maximum(0, simulated.integrals[0] - 1),
        ]
    )
    np.testing.assert_allclose(found.residual, np.linalg.norm(residuals, axis=0))
    expected = found.objective + 7 * (found.residual**2 + simulated.violation)
    np.testing.assert_allclose(fitness(genes), expected)
    np.testing.assert_allclose(fitness(np.tile(genes, (40, 1)))[:4], expected)  # in several blocks


def test_what_has_no_value_is_infinitely_bad(regulator: dict[str, Any]) -> None:
    regulator["problem"]["model"]["dynamics"]["x"] = "u + sqrt(x - 2)"
    model = model_of(regulator)
    genome = genome_of(model, DaubechiesBasis(2, 3))
    assert np.all(Fitness(model, genome, simulator_of(model, genome), 1.0)(population(genome, 3)) == np.inf)
