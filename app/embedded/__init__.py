"""The service in one process tree: a broker of its own, the worker and the API, supervised.

``binary`` finds a Redis-protocol server on this machine, ``broker`` says how it is run, ``supervisor``
starts, restarts and stops processes, ``guard`` ends them if the supervisor itself is killed, and
``service`` puts them together for ``ondelette serve`` and ``ondelette demo``.
"""
