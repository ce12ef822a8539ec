"""What can go wrong between a job and those who ask for it."""

from __future__ import annotations

from solvers.errors import OndeletteError


class JobNotFound(OndeletteError):
    """There is no job with this id, or nobody remembers it any more."""


class JobGone(OndeletteError):
    """The job was erased or its time of keeping has passed."""


class JobActive(OndeletteError):
    """The job has not ended yet, so it cannot be erased."""


class QueueUnavailable(OndeletteError):
    """The broker did not take the job; nothing was queued and nothing is remembered of it."""
