"""What can go wrong between a job and those who ask for it."""

from __future__ import annotations

from redis.exceptions import RedisError

from solvers.errors import OndeletteError


class JobNotFound(OndeletteError):
    """There is no job with this id, or nobody remembers it any more."""


class JobGone(OndeletteError):
    """The job was erased or its time of keeping has passed."""


class JobActive(OndeletteError):
    """The job has not ended yet, so it cannot be erased."""


class ResultLost(OndeletteError):
    """The job had a result, but where results are kept it is not there any more, or damaged."""


class ResultsUnavailable(OndeletteError):
    """The folder or object store in which results are kept does not answer."""


class WorkerStartError(OndeletteError):
    """A worker that is set up like this could not solve anything."""


class QueueUnavailable(OndeletteError):
    """The broker did not take the job; nothing was queued and nothing is remembered of it."""


STORE_AWAY = (RedisError, ResultsUnavailable)
"""What is raised while that which remembers jobs, or their results, is away: it may come back."""
