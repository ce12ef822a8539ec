"""Settings of the HTTP service, read from environment variables with the prefix ``ONDELETTE_``."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator
from pydantic_settings import NoDecode

from worker.settings import QueueSettings


class Settings(QueueSettings):
    """What the API needs besides the queue's settings."""

    allowed_hosts: Annotated[tuple[str, ...], NoDecode] = Field(
        default=(),
        description="Host names, separated by commas, under which the service may be asked, besides the "
        "loopback names and the address of the connection itself; * allows every name.",
    )
    reconcile_seconds: float = Field(
        default=10.0,
        gt=0,
        description="Period in which one of all API processes looks for jobs that nobody has, in seconds.",
    )
    body_bytes: int = Field(default=2 * 2**20, ge=1024, description="Largest request body, in bytes.")

    @field_validator("allowed_hosts", mode="before")
    @classmethod
    def _split(cls, value: object) -> object:
        if isinstance(value, str):
            return tuple(name.strip().lower() for name in value.split(",") if name.strip())
        return value
