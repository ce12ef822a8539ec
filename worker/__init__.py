"""The queue and what is remembered: Celery tasks, job records, results. No HTTP."""

import os

# Celery decides at import what SIGTERM means. A worker that is told to end must hand its jobs back after a
# short wait (the meaning of SIGQUIT), not go on for as long as its longest solve takes.
os.environ.setdefault("REMAP_SIGTERM", "SIGQUIT")
