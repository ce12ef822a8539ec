"""The HTTP service, put together."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from importlib.metadata import version

from fastapi import FastAPI

from app import errors, openapi
from app.auth import Gate
from app.middleware import BodyLimit, HeadAsGet, HostGuard, RequestContext
from app.observed import Observed
from app.routes import catalogue, commands, events, flights, health, jobs, pages, reports, results, sweeps
from app.service import Service
from app.settings import Settings
from app.upkeep import upkeep

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1", "testserver"})


def create_app(settings: Settings | None = None) -> FastAPI:
    """Return the application; ``settings`` default to the environment (prefix ``ONDELETTE_``).

    Nothing is connected yet: the broker may come up later, and the service says 503 until it does.
    """
    settings = settings or Settings()
    service = Service.of(settings)

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with (
            service.watch.running(),
            upkeep(service.reconciler, service.webhooks, settings.reconcile_seconds),
        ):
            yield
        service.close()

    app = FastAPI(
        title="ondelette",
        version=version("ondelette"),
        description="Solves optimal-control problems by direct methods and verifies every answer.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
    )
    app.state.service = service
    for group in (jobs, flights, events, results, commands, reports, sweeps, catalogue, health, pages):
        app.include_router(group.router)
    errors.install(app)
    openapi.install(app)
    # Added last is asked first.
    app.add_middleware(BodyLimit, limit=settings.body_bytes)
    app.add_middleware(Gate, doorkeeper=service.doorkeeper)
    app.add_middleware(HostGuard, names=LOOPBACK_NAMES | set(settings.allowed_hosts))
    app.add_middleware(HeadAsGet)
    app.add_middleware(Observed)
    app.add_middleware(RequestContext)
    return app
