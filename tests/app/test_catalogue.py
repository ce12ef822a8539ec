import httpx
import pytest

from solvers.catalogue import case_names, load_case
from tests.problems import problem


def test_models_are_listed(client: httpx.Client) -> None:
    models = {model["name"]: model for model in client.get("/v1/models").json()["models"]}
    assert {"rigid_body", "flexible_spacecraft"} <= set(models)
    for model in models.values():
        assert {"states", "controls", "parameters"} <= set(model)


def test_methods_are_listed_with_their_schemas(client: httpx.Client) -> None:
    methods = {method["name"]: method for method in client.get("/v1/methods").json()["methods"]}
    assert {"auto", "swcm", "gpm", "hermite_simpson"} <= set(methods)
    for method in methods.values():
        assert {"defaults", "schema"} <= set(method)
    assert methods["swcm"]["defaults"]["J"] == 4


def test_cases_are_listed_with_their_addresses(client: httpx.Client) -> None:
    cases = client.get("/v1/cases").json()["cases"]
    assert [case["name"] for case in cases] == list(case_names())
    for case in cases:
        assert client.get(case["href"]).json() == load_case(case["name"])


@pytest.mark.parametrize("name", ["flexible_spacecraft", "rigid_body"])
def test_a_case_is_ready_to_be_posted(client: httpx.Client, name: str) -> None:
    document = client.get(f"/v1/cases/{name}").json()
    response = client.post("/v1/jobs", json=document)
    assert response.status_code == 202
    assert response.json()["name"] == document["name"]


@pytest.mark.parametrize("name", ["warp_drive", "..%2Fcatalogue.py", "%00", "flexible_spacecraft.json"])
def test_an_unknown_case(client: httpx.Client, name: str) -> None:
    problem(client.get(f"/v1/cases/{name}"), 404, "not-found")
