"""Settings of the HTTP service, read from environment variables with the prefix ``ONDELETTE_``."""

from __future__ import annotations

import ipaddress
from pathlib import Path
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

    require_keys: bool = Field(
        default=False, description="Whether nobody enters without an API key, even if none was made yet."
    )
    bootstrap_key_file: Path | None = Field(
        default=None, description="File with a key of scope admin, for a service that has no other yet."
    )
    key_cache_seconds: float = Field(
        default=2.0, ge=0, description="Seconds after which a revoked key has lost its effect everywhere."
    )
    submit_rate: int = Field(
        default=600, ge=0, description="Submissions that a key may make a minute; 0 for any number."
    )
    request_rate: int = Field(
        default=6000, ge=0, description="Other requests that a key may make a minute; 0 for any number."
    )
    project_jobs: int = Field(
        default=20_000, ge=1, description="Jobs of one project that may wait or run at a time."
    )
    queued_jobs: int = Field(
        default=100_000, ge=1, description="Jobs that may wait at a time; then submissions are refused."
    )
    project_waiting: int = Field(
        default=200,
        ge=1,
        description="Requests of one project that may wait in one API process at a time: streams of events "
        "and long polls.",
    )
    process_waiting: int = Field(
        default=500, ge=1, description="Requests of all projects that may wait in one API process at a time."
    )

    webhook_secret_file: Path | None = Field(
        default=None,
        description="File with the secrets that webhooks are signed with; without it there are none.",
    )
    webhook_networks: Annotated[tuple[str, ...], NoDecode] = Field(
        default=(),
        description="Networks, separated by commas, that are not public and to which webhooks may go all the "
        "same; to an IP address in them also by plain http.",
    )

    @field_validator("allowed_hosts", "webhook_networks", mode="before")
    @classmethod
    def _split(cls, value: object) -> object:
        if isinstance(value, str):
            return tuple(name.strip().lower() for name in value.split(",") if name.strip())
        return value

    @field_validator("webhook_networks")
    @classmethod
    def _are_networks(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for text in value:
            ipaddress.ip_network(text)
        return value
