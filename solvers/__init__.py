"""The mathematics of ondelette: problems, transcriptions, optimizers, verification.

Works in a notebook with neither broker nor server; nothing here knows of HTTP or queues.
"""
