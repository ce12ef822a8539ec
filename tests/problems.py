"""How tests read a refusal of the service."""

from __future__ import annotations

from typing import Any

import httpx


def problem(response: httpx.Response, status: int, name: str) -> dict[str, Any]:
    """Return the members of a problem document, which must be of this kind and complete."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    members: dict[str, Any] = response.json()
    assert members["type"] == f"/problems/{name}"
    assert members["status"] == status
    assert members["request_id"] == response.headers["x-request-id"]
    return members
