"""The answers of the service, as clients read them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field, SerializerFunctionWrapHandler, model_serializer

from worker.records import FailureType, JobRecord, JobStatus, Priority, timestamp


class ProgressView(BaseModel):
    """The last report of a running solve; ``fraction`` in [0, 1] is an estimate."""

    stage: str
    iteration: int
    objective: float | None
    infeasibility: float | None
    fraction: float | None
    diversity: float | None = Field(
        None, description="Of a population: how far its genes are from their mean."
    )

    @model_serializer(mode="wrap")
    def _without_what_is_not_there(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields: dict[str, Any] = handler(self)
        if self.diversity is None:
            del fields["diversity"]
        return fields


class JobErrorView(BaseModel):
    """Why a job failed."""

    type: FailureType
    title: str
    detail: str


class VerificationView(BaseModel):
    """The scaled maxima of a verification, and whether every check of it passed."""

    terminal_error: float | None
    max_state_error: float | None
    max_bound_violation: float | None
    max_path_violation: float | None
    passed: bool


class JobLinks(BaseModel):
    """Where the parts of a job are."""

    self: str
    spec: str
    cancel: str
    pin: str
    events: str
    result: str
    trajectory: str
    plot: str
    report: str
    bundle: str
    flights: str


class JobView(BaseModel):
    """A job; times are RFC 3339 in UTC."""

    id: str
    name: str | None
    tags: list[str]
    status: JobStatus
    method: str
    priority: Priority
    created_at: str
    deadline_at: str | None = Field(description="When nobody waits for the answer any more.")
    started_at: str | None
    finished_at: str | None
    expires_at: str | None = Field(description="Until when an ended job is kept; null if it is pinned.")
    pinned: bool = Field(description="True if it is kept until it is erased.")
    reused_from: str | None = Field(description="The earlier job whose answer it has, if it was not solved.")
    progress: ProgressView | None
    error: JobErrorView | None
    attempts: int = Field(description="How often a worker started it.")
    cancel_requested: bool = Field(
        description="True from the moment at which a running job was asked to stop."
    )
    project: str
    submitted_by: str | None = Field(description="Id of the API key that it was submitted with.")
    sweep: str | None = Field(description="Id of the sweep that it is a point of.")
    flights_of: str | None = Field(description="Id of the job whose answer it flies.")
    links: JobLinks

    @classmethod
    def of(cls, record: JobRecord) -> JobView:
        """Return the view of a job record."""
        here = f"/v1/jobs/{record.id}"
        error = record.error
        return cls(
            id=record.id,
            name=record.name,
            tags=list(record.tags),
            status=record.status,
            method=record.method,
            priority=record.priority,
            created_at=timestamp(record.created_at),
            deadline_at=_moment(record.deadline_at),
            started_at=_moment(record.started_at),
            finished_at=_moment(record.finished_at),
            expires_at=_moment(record.expires_at),
            pinned=record.pinned,
            reused_from=record.reused_from,
            progress=None if record.progress is None else ProgressView.model_validate(record.progress),
            error=None
            if error is None
            else JobErrorView(type=error.type, title=error.title, detail=error.detail),
            attempts=record.attempts,
            cancel_requested=record.cancel_requested,
            project=record.project,
            submitted_by=record.submitted_by,
            sweep=None if record.sweep is None else record.sweep.sweep,
            flights_of=record.flights_of,
            links=JobLinks(
                self=here,
                spec=f"{here}/spec",
                cancel=f"{here}/cancel",
                pin=f"{here}/pin",
                events=f"{here}/events",
                result=f"{here}/result",
                trajectory=f"{here}/trajectory",
                plot=f"{here}/plot.svg",
                report=f"{here}/report.html",
                bundle=f"{here}/bundle.zip",
                flights=f"{here}/flights",
            ),
        )


def _moment(seconds: float | None) -> str | None:
    return None if seconds is None else timestamp(seconds)


class JobPage(BaseModel):
    """A page of jobs, newest first; ``next_cursor`` is null on the last page."""

    jobs: list[JobView]
    next_cursor: str | None


class SizeView(BaseModel):
    """What a document asks of a worker: the nonlinear program's size, and about how long it takes (s)."""

    valid: bool = True
    method: str
    variables: int
    constraints: int
    nodes: int
    seconds: float


class ModelList(BaseModel):
    """The library models."""

    models: list[dict[str, Any]]


class MethodList(BaseModel):
    """The methods with their defaults and JSON Schemas."""

    methods: list[dict[str, Any]]


class CaseView(BaseModel):
    """A case on board; ``href`` is its job document."""

    name: str
    title: str
    method: str
    reference: dict[str, Any] | None
    href: str


class CaseList(BaseModel):
    """The cases on board."""

    cases: list[CaseView]


class HealthView(BaseModel):
    """The process answers."""

    status: str = "ok"


class ReadyView(BaseModel):
    """The broker answers and workers are alive: by name, the number of jobs that each solves at a time."""

    status: str = "ready"
    workers: dict[str, int]
    queued: int
