"""What a client can do with a result by itself, against what the service answers."""

from __future__ import annotations

import json
import pickle
import sys
import zlib
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np
import pytest

from app.client import MissingExtraError, NotFiniteError, Result
from solvers.builders import library
from solvers.solve import solve
from solvers.spec import check_document
from tests.solvers.phases.test_phases import BOUNCE
from worker.records import JobStatus


@pytest.fixture(scope="session")
def result(solved: bytes) -> Result:
    return Result(json.loads(zlib.decompress(solved)))


def test_a_result_is_the_dictionary_that_the_service_tells(result: Result) -> None:
    plain = json.loads(json.dumps(result))
    assert plain == result
    assert isinstance(result, dict)
    assert pickle.loads(pickle.dumps(result)).at(1.0).t == 1.0
    assert (result.success, result.objective, result.final_time) == (
        True,
        result["objective"],
        result["final_time"],
    )


def test_samples_are_arrays(result: Result) -> None:
    told = result["trajectory"]
    np.testing.assert_array_equal(result.t, told["t"])
    for group, arrays in (
        ("states", result.states),
        ("controls", result.controls),
        ("outputs", result.outputs),
    ):
        assert list(arrays) == list(told[group])
        for name, values in arrays.items():
            assert values.dtype == np.float64
            np.testing.assert_array_equal(values, told[group][name])


def test_it_is_evaluated_as_the_service_evaluates_it(
    client: httpx.Client, job: Callable[..., str], solved: bytes, result: Result
) -> None:
    numbers = np.random.default_rng(3)
    times = np.sort(numbers.uniform(0, result["final_time"], 50))
    told = client.get(
        f"/v1/jobs/{job(JobStatus.SUCCEEDED, solved)}/trajectory",
        params={"t": ",".join(map(repr, times.tolist())), "derivatives": 1},
    ).json()
    here = result.at(times.reshape(5, 10), derivatives=True)
    assert here.t.shape == (5, 10)
    for group in ("states", "controls", "outputs", "rates"):
        arrays = getattr(here, group)
        assert list(arrays) == list(told[group])
        for name, values in told[group].items():
            np.testing.assert_array_equal(arrays[name].ravel(), values)


def test_a_flight_of_phases_is_evaluated_in_any_order() -> None:
    """Where the ball bounces, a time gives the velocity after it, and standing twice both."""
    flight = Result(solve(check_document({**BOUNCE, "method": {"name": "swcm", "J": 2}})).result())
    there = np.array([[1.5, 0.25], [1.0, 0.5], [1.0, 1.0]])
    here = flight.at(there, derivatives=True)
    for when, states in ((1.5, 1), (0.25, 0)):
        alone = flight.at(when, derivatives=True)
        assert here.states["x"][0][1 - states] == alone.states["x"]
        assert here.rates["x"][0][1 - states] == alone.rates["x"] == alone.states["x_dot"]
    # w = -3 (1 + e) / (2 (1 + e^2)) before, -e w after it, with e = 1/2.
    np.testing.assert_allclose(here.states["x_dot"][[1, 2, 2], [0, 0, 1]], [0.9, -1.8, 0.9], atol=1e-3)
    np.testing.assert_allclose(flight.at(flight.t).states["x_dot"], flight.states["x_dot"], atol=1e-12)


def test_at_the_nodes_it_is_what_the_method_found(result: Result) -> None:
    nodes = result["nodes"]
    here = result.at(nodes["t"])
    for name, values in nodes["states"].items():
        np.testing.assert_allclose(here.states[name], values, atol=1e-12)
    assert here.rates == {}
    one = result.at(nodes["t"][3])
    assert isinstance(one.states["theta"], float)
    assert one.states["theta"] == pytest.approx(nodes["states"]["theta"][3], abs=1e-12)


@pytest.mark.parametrize(
    "method",
    [{"name": "gpm"}, {"name": "hermite_simpson"}, {"name": "ga", "generations": 5, "population": 8}],
    ids=lambda method: str(method["name"]),
)
def test_every_basis_is_evaluated_here(method: dict[str, Any]) -> None:
    document = {
        "problem": {
            "model": library("rigid_body"),
            "final_time": [0.5, 10],
            "initial_state": {"*": 0},
            "final_state": {"x": 1, "x_dot": 0},
            "bounds": {"u": [-1, 1]},
            "objective": {"terminal": "tf"},
        },
        "method": method,
    }
    solved = Result(solve(check_document(document)).result())
    again = Result(json.loads(json.dumps(solved))).at(solved.t)
    for here, told in ((again.states, solved.states), (again.controls, solved.controls)):
        for name, values in told.items():
            np.testing.assert_allclose(here[name], values, rtol=1e-13, atol=1e-13)


def test_outside_the_trajectory_there_is_nothing(result: Result) -> None:
    for times in (-1.0, [0, 1e3], np.nan):
        with pytest.raises(ValueError, match="within the trajectory"):
            result.at(times)


def test_an_iterate_that_diverged_cannot_be_evaluated(diverged: bytes) -> None:
    result = Result(json.loads(zlib.decompress(diverged)))
    with pytest.raises(NotFiniteError, match="not finite"):
        result.at(1.0)
    assert np.isnan(result.states["theta"]).all()
    assert result.objective is None


def test_a_dataset_with_units(result: Result) -> None:
    with_units = Result(json.loads(json.dumps(result)))
    with_units["resolved"]["document"]["problem"]["units"] = {"theta": "rad", "t": "s"}
    data = with_units.to_xarray()
    assert data.sizes == {"t": np.unique(result.t).size}
    assert data["theta"].attrs == {"kind": "state", "units": "rad"}
    assert data["T"].attrs == {"kind": "control"}
    assert data["root_moment"].attrs["kind"] == "output"
    assert data["t"].attrs == {"units": "s"}
    assert data.attrs["objective"] == result["objective"]
    switch = result["switching"]["T"]["times"][0]
    assert data["T"].sel(t=switch) == result.controls["T"][np.flatnonzero(result.t == switch)[1]]
    np.testing.assert_allclose(data["alpha"].sel(t=result.t), result.states["alpha"], atol=1e-12)


def test_without_xarray_the_error_says_what_to_install(
    result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(MissingExtraError, match="pip install xarray"):
        result.to_xarray()


def test_a_picture_has_a_row_for_each_quantity(result: Result) -> None:
    figure = result.plot("slew")
    assert [axis.get_ylabel() for axis in figure.axes] == [
        *result["trajectory"]["states"],
        *result["trajectory"]["controls"],
        *result["trajectory"]["outputs"],
    ]
