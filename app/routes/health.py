"""Is the process up, and can it do anything?"""

from __future__ import annotations

from fastapi import APIRouter, Response
from redis.exceptions import RedisError

from app.errors import ServiceError
from app.metrics import CONTENT_TYPE, exposition
from app.openapi import refusals
from app.schemas import HealthView, ReadyView
from app.service import Shared

router = APIRouter(tags=["health"])


# Not a plain function: all threads may be waiting for a broker that does not answer.
@router.get("/livez")
async def livez() -> HealthView:
    """Tell that the process answers."""
    return HealthView()


@router.get("/readyz", responses=refusals(503))
def readyz(service: Shared) -> ReadyView:
    """Tell whether the broker answers and a worker is alive."""
    try:
        workers, queued = service.queue.workers(), service.queue.depth()
    except RedisError as error:
        raise _not_ready("The broker does not answer.") from error
    if not workers:
        raise _not_ready("No worker is alive; jobs are accepted but wait for one.")
    return ReadyView(workers=workers, queued=queued)


@router.get(
    "/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}, **refusals(503)}
)
def metrics(service: Shared) -> Response:
    """Tell the numbers of the service in Prometheus' text format; every API process tells the same ones."""
    return Response(exposition(service.store, service.queue), media_type=CONTENT_TYPE)


def _not_ready(detail: str) -> ServiceError:
    return ServiceError("unavailable", detail, headers={"Retry-After": "2"})
