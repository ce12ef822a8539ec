"""Cases, library models and methods on board: complete, consistent, and with reference answers that hold."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad, solve_bvp, solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, root

from solvers.catalogue import case_names, load_case, methods, models
from solvers.errors import DocumentError
from solvers.expressions import parse
from solvers.models import LIBRARY
from solvers.spec import LibraryReference, MechanicalModel, check_document, initial_intervals

Vector = NDArray[np.float64]

CASES = [
    "brachistochrone",
    "bryson_denham",
    "edt_dipole",
    "edt_igrf",
    "flexible_spacecraft",
    "free_flying_robot",
    "goddard",
    "hypersensitive",
    "keep_out_slew",
    "min_time_orbit_transfer",
    "pse",
    "rigid_body",
    "solar_array_1",
    "solar_array_2",
    "solar_array_2neg",
    "three_axis_slew",
    "two_mass_spring",
    "van_der_pol",
]


def test_the_cases_are_on_board() -> None:
    assert case_names() == CASES


@pytest.mark.parametrize("name", CASES)
def test_case_is_a_valid_document_with_a_reference(name: str) -> None:
    case = load_case(name)
    spec = check_document(case)
    assert spec.name
    reference = case["reference"]
    assert set(reference) == {"objective", "final_time", "switching", "source"}
    assert math.isfinite(reference["objective"])
    assert len(reference["source"]) > 20
    controls = spec.problem.model.controls
    for control, times in (reference["switching"] or {}).items():
        assert control in controls
        assert times == sorted(times)
        assert times[0] > 0
        assert times[-1] < reference["final_time"]
    resolved = spec.resolved().document["problem"]["model"]
    given = case["problem"]["model"]
    parameters = resolved.get("parameters", {}), given.get("parameters", {})
    assert resolved | {"parameters": {}} == resolved | given | {"parameters": {}}
    assert parameters[0] == parameters[0] | parameters[1]  # a library model has all of them listed
    assert initial_intervals(spec.problem).keys() == set(spec.problem.model.states)


@pytest.mark.parametrize(
    "name", ["", "nothing", "../models/rigid_body", "rigid_body.json", "flexible_spacecraft/"]
)
def test_unknown_case(name: str) -> None:
    with pytest.raises(KeyError):
        load_case(name)


def test_a_loaded_case_is_a_copy() -> None:
    load_case("rigid_body")["problem"].clear()
    assert load_case("rigid_body")["problem"]


@pytest.mark.parametrize("name", ["rigid_body", "flexible_spacecraft"])
def test_library_model_is_that_of_its_case(name: str) -> None:
    case = load_case(name)
    reference = case | {"problem": case["problem"] | {"model": {"kind": "library", "name": name}}}
    library = check_document(reference).problem.model
    written = check_document(case).problem.model
    assert isinstance(library, MechanicalModel)
    assert isinstance(written, MechanicalModel)
    assert library.parameter_values() == written.parameter_values()
    for matrix in ("mass", "damping", "stiffness", "input"):
        assert getattr(library, matrix) == getattr(written, matrix)


def test_models_describe_every_name() -> None:
    listed = models()
    assert [entry["name"] for entry in listed] == list(LIBRARY)
    for entry in listed:
        assert json.loads(json.dumps(entry)) == entry
        reference = LibraryReference.model_construct(kind="library", name=entry["name"], parameters={})
        model = reference.expand()
        assert tuple(entry["states"]) == model.states
        assert tuple(entry["controls"]) == model.controls
        assert entry["parameters"].keys() == model.parameter_values().keys()
        for quantities in (entry["states"], entry["controls"], entry["parameters"], entry["computed"]):
            assert all(quantity["unit"] and quantity["description"] for quantity in quantities.values())


def test_a_plant_is_flown_and_not_optimised() -> None:
    plants = [entry["name"] for entry in models() if entry["plant_only"]]
    assert plants == ["edt_plant"]
    problem = {"final_time": 1, "initial_state": {"*": 0}, "objective": {"terminal": "tf"}}
    with pytest.raises(DocumentError) as refusal:
        check_document({"problem": problem | {"model": {"kind": "library", "name": "edt_plant"}}})
    assert [(fault.pointer, "method.plant" in fault.detail) for fault in refusal.value.faults] == [
        ("/problem/model/name", True)
    ]


def test_methods_list_their_defaults_and_schemas() -> None:
    listed = {entry["name"]: entry for entry in methods()}
    assert json.loads(json.dumps(listed)) == listed
    assert {name: entry["defaults"] for name, entry in listed.items()} == {
        "auto": {"accuracy": 1e-6},
        "swcm": {"L": 8, "J": 4},
        "gpm": {"nodes": 40, "segments": 1},
        "hermite_simpson": {"intervals": 60},
        "ga": {
            "wavelet": "db2",
            "boundary": "periodic",
            "scaling_functions": 5,
            "wavelet_levels": 0,
            "population": 48,
            "generations": 2000,
            "refine_generations": 200,
            "crossover_probability": 0.9,
            "mutation_probability": 0.1,
            "mutation_sigma": 1.0,
            "elite": 1,
            "penalty": 100.0,
            "seed": 0,
            "processes": 1,
            "variant": "modern",
            "polish": "exact",
        },
        "piecewise": {
            "nodes": 20,
            "scheme": "lookahead",
            "lookahead": 2,
            "smoothing": 1e-5,
            "tracking": {"Q": {}, "R": {}, "S": {}, "horizon": "end", "limits": {}},
        },
    }
    for name, entry in listed.items():
        assert entry["title"]
        assert entry["schema"]["properties"]["name"]["const"] == name
        assert entry["defaults"].keys() <= entry["schema"]["properties"].keys()


# Reference answers, worked out here from the case's own document by means that no solver of ours shares.


def dynamics(name: str) -> Any:
    """Return f(t, x, u) of a case, with its parameters filled in."""
    model = check_document(load_case(name)).problem.model
    values = model.parameter_values()

    def matrix(rows: Any, names: dict[str, float]) -> Vector:
        return np.array([[float(parse(entry).evaluate(names)) for entry in row] for row in rows])

    def rate(t: float, x: Vector, u: float) -> Vector:
        names = {
            **values,
            "t": t,
            model.controls[0]: u,
            **dict(zip(model.states, map(float, x), strict=True)),
        }
        if not isinstance(model, MechanicalModel):
            return np.array([float(parse(model.dynamics[state]).evaluate(names)) for state in model.states])
        q, v = np.split(x, 2)
        load = matrix(model.input, names) @ np.array([u])
        for rows, factor in ((model.damping, v), (model.stiffness, q)):
            load -= matrix(rows, names) @ factor if rows is not None else 0
        return np.concatenate([v, np.linalg.solve(matrix(model.mass, names), load)])

    return rate


def reference_of(name: str) -> dict[str, Any]:
    reference: dict[str, Any] = load_case(name)["reference"]
    return reference


@pytest.mark.parametrize(
    ("name", "control", "level", "target", "tolerance"),
    [
        ("rigid_body", "u", 1.0, [1, 0], 1e-9),
        ("two_mass_spring", "u", 1.0, [1, 1, 0, 0], 1e-8),
        ("flexible_spacecraft", "T", 5.0, [math.pi / 6, 0, 0, 0], 1e-8),
    ],
)
def test_bang_bang_references_reach_the_target(
    name: str, control: str, level: float, target: list[float], tolerance: float
) -> None:
    rate, reference = dynamics(name), reference_of(name)
    x, start = np.zeros(len(target)), 0.0
    for end in [*reference["switching"][control], reference["final_time"]]:
        flight = solve_ivp(rate, (start, end), x, args=(level,), method="DOP853", rtol=1e-11, atol=1e-13)
        x, start, level = flight.y[:, -1], end, -level
    np.testing.assert_allclose(x, target, atol=tolerance)


def test_two_mass_spring_by_matrix_exponentials() -> None:
    a = np.zeros((5, 5))
    a[:4, :4] = [[0, 0, 1, 0], [0, 0, 0, 1], [-1, 1, 0, 0], [1, -1, 0, 0]]

    def miss(times: Vector) -> Vector:
        x, sign, start = np.zeros(4), 1.0, 0.0
        for end in times:
            a[:4, 4] = [0, 0, sign, 0]
            step = expm(a * (end - start))
            x, sign, start = step[:4, :4] @ x + step[:4, 4], -sign, end
        return x - [1, 1, 0, 0]

    reference = reference_of("two_mass_spring")
    times = root(miss, [1.0, 2.1, 3.2, 4.2], tol=1e-14).x
    np.testing.assert_allclose(times, [*reference["switching"]["u"], reference["objective"]], atol=1e-9)


def test_brachistochrone_by_the_cycloid() -> None:
    angle = brentq(lambda phi: (phi - math.sin(phi)) / (1 - math.cos(phi)) - 2, 0.1, 6.0, xtol=1e-15)
    radius = 5 / (1 - math.cos(angle))
    wanted = angle * math.sqrt(radius / 9.80665)
    assert reference_of("brachistochrone")["objective"] == pytest.approx(wanted, abs=1e-12)


def test_bryson_denham_in_closed_form() -> None:
    l = check_document(load_case("bryson_denham")).problem.model.parameter_values()["l"]  # noqa: E741
    # u = -2/(3 l) (1 - t/(3 l)) until 3 l, nothing until 1 - 3 l, the mirror image after.
    effort = quad(lambda t: (2 / (3 * l) * (1 - t / (3 * l))) ** 2 / 2, 0, 3 * l)[0]
    assert reference_of("bryson_denham")["objective"] == pytest.approx(2 * effort, rel=1e-12)


def test_hypersensitive_by_its_boundary_layers() -> None:
    spec = check_document(load_case("hypersensitive"))
    assert spec.problem.initial_state == {"x": 1.5}
    assert spec.problem.final_state == {"x": 1}
    # H = 0 on both layers: the costate is -x^3 + sqrt(x^6 + x^2) going in, -x^3 - sqrt(x^6 + x^2) coming out.
    going_in = quad(lambda x: math.sqrt(x**6 + x**2) - x**3, 0, 1.5, epsabs=1e-14)[0]
    coming_out = quad(lambda x: math.sqrt(x**6 + x**2) + x**3, 0, 1, epsabs=1e-14)[0]
    assert reference_of("hypersensitive")["objective"] == pytest.approx(going_in + coming_out, abs=1e-12)


def test_van_der_pol_by_its_boundary_value_problem() -> None:
    def conditions(t: Vector, y: Vector) -> Vector:
        x, v, p, q, _ = y
        cost = (x**2 + v**2 + q**2) / 2
        force = (1 - x**2) * v - x - q
        return np.vstack([v, force, -(x - q * (2 * x * v + 1)), -(v + p + q * (1 - x**2)), cost])

    def ends(a: Vector, b: Vector) -> Vector:
        return np.array([a[0] - 1, a[1], b[2], b[3], a[4]])

    solution = solve_bvp(
        conditions, ends, np.linspace(0, 2, 40), np.full((5, 40), 0.1), tol=1e-9, max_nodes=10_000
    )
    assert solution.success
    assert reference_of("van_der_pol")["objective"] == pytest.approx(solution.y[4, -1], abs=1e-9)


def test_orbit_transfer_by_indirect_shooting() -> None:
    rate = dynamics("min_time_orbit_transfer")

    def conditions(t: float, y: Vector) -> Vector:
        r, u, v, p_r, p_u, p_v = y
        x_rate = rate(t, y[:3], math.atan2(-p_u, -p_v))
        return np.concatenate(
            [
                x_rate,
                [
                    p_u * (v**2 / r**2 - 2 / r**3) - p_v * u * v / r**2,
                    p_v * v / r - p_r,
                    -2 * p_u * v / r + p_v * u / r,
                ],
            ]
        )

    reference = reference_of("min_time_orbit_transfer")
    start = np.array([1, 0, 1, -5.27114375, -2.60881016, -5.68517149])

    def miss(unknowns: Vector) -> Vector:
        flight = solve_ivp(
            conditions,
            (0, unknowns[3]),
            [*start[:3], *unknowns[:3]],
            method="DOP853",
            rtol=1e-11,
            atol=1e-12,
        )
        end = flight.y[:, -1]
        hamiltonian = 1 + end[3:] @ conditions(unknowns[3], end)[:3]
        return np.array([end[0] - 1.525, end[1], end[2] - 1.525**-0.5, hamiltonian])

    solution = root(miss, [*start[3:], 3.3], tol=1e-11)
    assert solution.success
    assert reference["objective"] == pytest.approx(solution.x[3], abs=1e-9)


def test_goddard_by_its_three_arcs() -> None:
    rate, reference = dynamics("goddard"), reference_of("goddard")

    def drag(y: Vector) -> float:
        return float(310 * y[1] ** 2 * math.exp(-500 * (y[0] - 1)))

    def surface(t: float, y: Vector) -> float:
        """Where thrust is singular: D (1 + v/c) = m g."""
        return float(drag(y) * (1 + 2 * y[1]) - y[2] / y[0] ** 2)

    def singular_thrust(t: float, y: Vector) -> float:
        """The thrust that stays on the surface, which is linear in it."""
        h, v, m = y
        gradient = np.array(
            [
                -500 * drag(y) * (1 + 2 * v) + 2 * m / h**3,
                2 * drag(y) / v * (1 + 2 * v) + 2 * drag(y),
                -1 / h**2,
            ]
        )
        without, one = gradient @ rate(t, y, 0.0), gradient @ rate(t, y, 1.0)
        return float(without / (without - one))

    def empty(t: float, y: Vector) -> float:
        return float(y[2] - 0.6)

    def top(t: float, y: Vector) -> float:
        return float(y[1])

    y, t, times = np.array([1.0, 1e-200, 1.0]), 0.0, []
    for thrust, event in ((lambda t, y: 3.5, surface), (singular_thrust, empty), (lambda t, y: 0.0, top)):
        event.terminal, event.direction = True, 1 if event is surface else -1  # type: ignore[attr-defined]

        def flown(t: float, y: Vector, thrust: Any = thrust) -> Vector:
            return np.asarray(rate(t, y, thrust(t, y)))

        flight = solve_ivp(flown, (t, 1), y, events=event, method="DOP853", rtol=1e-11, atol=1e-13)
        y, t = flight.y[:, -1], flight.t[-1]
        times.append(t)
    assert -y[0] == pytest.approx(reference["objective"], abs=1e-9)
    np.testing.assert_allclose(times, [*reference["switching"]["T"], reference["final_time"]], atol=1e-8)
