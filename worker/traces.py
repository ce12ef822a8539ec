"""OpenTelemetry traces, where they are configured: from a request through the queue into the solve.

They are on when ``OTEL_EXPORTER_OTLP_ENDPOINT`` (or that of traces alone) says where they go, which needs the
packages of the extra ``otel``; headers, sampling and more are set by OpenTelemetry's own variables. FastAPI
makes the spans of requests; the context travels in the headers of the message (W3C ``traceparent``).
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from importlib.util import find_spec

from opentelemetry import propagate, trace
from opentelemetry.trace import SpanKind

from solvers.errors import OndeletteError

_WHERE = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
_tracer = trace.get_tracer("ondelette")


class TracesMissing(OndeletteError):
    """Traces are asked for, and the packages that send them are not installed."""


def configured() -> bool:
    """Tell whether the environment says where traces go."""
    return any(os.environ.get(name) for name in _WHERE)


def require() -> None:
    """Raise TracesMissing where traces are configured and cannot be sent."""
    if configured() and find_spec("opentelemetry.exporter") is None:
        raise TracesMissing(
            "OTEL_EXPORTER_OTLP_ENDPOINT is set, but the packages that send traces are not installed: "
            "pip install 'ondelette[otel]'"
        )


def start(service: str) -> None:
    """Begin to send traces of this process as those of ``service``, if they are configured.

    To be called in each process anew: the thread that sends does not survive a fork. Raises TracesMissing.
    """
    if not configured():
        return
    require()
    from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import BatchSpanProcessor

    provider = TracerProvider(resource=Resource.create({"service.name": service}))
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)


def flush() -> None:
    """Send what has not been sent yet."""
    force = getattr(trace.get_tracer_provider(), "force_flush", None)
    if force is not None:
        force()


def carried() -> dict[str, str]:
    """Return the headers that carry the present context; none where there is none."""
    headers: dict[str, str] = {}
    propagate.inject(headers)
    return headers


@contextlib.contextmanager
def span(
    name: str,
    kind: SpanKind = SpanKind.INTERNAL,
    *,
    headers: Mapping[str, str] | None = None,
    **attributes: str | int | float,
) -> Iterator[trace.Span]:
    """Make what happens in this context a span, below that which ``headers`` carry if there are any."""
    parent = propagate.extract(headers) if headers else None
    with _tracer.start_as_current_span(name, parent, kind, attributes) as current:
        yield current
