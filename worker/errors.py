"""What can go wrong between a job and those who ask for it."""

from __future__ import annotations

import re

from redis.exceptions import (
    AuthenticationError,
    ClusterDownError,
    NoPermissionError,
    OutOfMemoryError,
    ReadOnlyError,
    RedisError,
)

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

_REFUSING = (OutOfMemoryError, ReadOnlyError, ClusterDownError, NoPermissionError)
# As an older server has it from within a script, with words of its own before it.
_REFUSALS = re.compile(r"(^|-)(MISCONF|NOREPLICAS|BUSY|OOM|READONLY)\b")


def reason_of(error: RedisError) -> str:
    """Return what the server said, without the command that a pipeline adds: it may hold a document."""
    text = str(error)
    return text.rpartition(" caused error: ")[2] if text.startswith("Command #") else text


def takes_nothing(error: RedisError) -> bool:
    """Tell whether a server answers, but takes nothing new: full, without a disk, a replica, not for us."""
    return isinstance(error, _REFUSING) or _REFUSALS.search(reason_of(error)) is not None


def broker_fault(error: RedisError) -> str:
    """Return what is wrong with the server, for whoever runs it."""
    if isinstance(error, AuthenticationError):
        return "the broker refuses the password in its address, or wants one: redis://:PASSWORD@host:6379/0"
    said = reason_of(error)
    return f"the broker {'takes nothing' if takes_nothing(error) else 'does not answer'}: {said}"
