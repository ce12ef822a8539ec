"""The one error of starting an embedded service."""

from __future__ import annotations

from solvers.errors import OndeletteError


class ServiceStartError(OndeletteError):
    """The service cannot start as asked; the message says what is in the way and what would help."""
