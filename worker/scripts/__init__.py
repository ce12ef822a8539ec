"""The changes of a job that must be one step for everyone: Lua scripts run inside the server."""
