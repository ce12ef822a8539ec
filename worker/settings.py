"""Settings of the queue and its workers, read from environment variables with the prefix ``ONDELETTE_``."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from worker.address import celery_url
from worker.blobs import check_address


class QueueSettings(BaseSettings):
    """What everyone who touches the queue must agree on: the API, the workers and the command line."""

    model_config = SettingsConfigDict(env_prefix="ONDELETTE_", extra="ignore", frozen=True)

    broker: str = Field(
        default="redis://127.0.0.1:6379/0", description="Address of the Redis or Valkey server."
    )
    prefix: str = Field(default="ondelette:", description="Prefix of every key in the server.")
    results: str | None = Field(
        default=None,
        description="Folder or object store for results, as file:///folder or s3://bucket/prefix; without it "
        "they are in the server's memory.",
    )
    log_format: Literal["text", "json"] = Field(default="text", description="How log lines are written.")
    log_level: Literal["DEBUG", "INFO", "WARNING", "ERROR"] = Field(
        default="INFO", description="The least that is logged."
    )
    retention_days: float = Field(default=30.0, gt=0, description="How long a finished job is kept, in days.")
    grace_seconds: float = Field(
        default=30.0,
        ge=1,
        description="Seconds beyond options.max_seconds after which a worker's child is ended.",
    )
    visibility_seconds: float = Field(
        default=30.0,
        ge=1,
        description="Seconds of silence after which a worker is lost and its jobs are given to others.",
    )
    renewal_seconds: float = Field(
        default=10.0, gt=0, description="Period in which a worker renews the leases of its jobs, in seconds."
    )
    sweep_seconds: float = Field(
        default=5.0,
        gt=0,
        description="Period in which workers look for messages of lost ones, in seconds.",
    )
    outage_seconds: float = Field(
        default=600.0,
        ge=0,
        description="Seconds for which a solve tries to store its answer while the broker is away.",
    )

    @field_validator("broker")
    @classmethod
    def _broker_is_an_address(cls, value: str) -> str:
        celery_url(value)
        return value

    @field_validator("results")
    @classmethod
    def _results_can_be_reached(cls, value: str | None) -> str | None:
        return check_address(value) if value else None

    @model_validator(mode="after")
    def _leases_outlive_a_missed_renewal(self) -> Self:
        if self.visibility_seconds < 3 * self.renewal_seconds:
            raise ValueError(
                "visibility_seconds must be at least three times renewal_seconds, for a renewal may be late"
            )
        return self

    @property
    def retention_seconds(self) -> int:
        """How long a finished job is kept, in seconds."""
        return max(1, round(self.retention_days * 86_400))

    @property
    def lease_seconds(self) -> float:
        """How long a running job belongs to a solve that is silent, in seconds.

        Shorter than the silence after which its message is delivered again: whoever gets it may then start.
        """
        return self.visibility_seconds - self.renewal_seconds


class WorkerSettings(QueueSettings):
    """What a worker needs besides: limits of its children and the rhythm of its messages (seconds)."""

    result_mib: float = Field(default=32.0, gt=0, description="Largest compressed result, in MiB.")
    memory_mib: int = Field(
        default=4096, ge=256, description="Address space of one child process, in MiB; more is out_of_memory."
    )
    tasks_per_child: int = Field(
        default=200, ge=1, description="Jobs after which a child process is replaced."
    )
    shutdown_seconds: float = Field(
        default=8.0,
        ge=0,
        description="Seconds for which running jobs may go on after SIGTERM; then they are handed back.",
    )
    heartbeat_seconds: float = Field(
        default=3.0, gt=0, description="Period of a worker's heartbeat, in seconds."
    )
