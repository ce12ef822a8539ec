"""The changes of a job that must be one step for everyone: Lua scripts run inside the server.

Every script has KEYS = record, document, result, tombstone and ARGV = id, channel, now, retention, memory
(how long, in seconds, an ended job is kept, and how long after that it is known to have existed), and its own
arguments from ARGV[6] on. Whoever solves a job is its ``owner``, a random word written at the start: what any
other solve of the same job writes later (a worker given up for lost, a message delivered twice) changes
nothing.
"""

from __future__ import annotations

_COMMON = """
local function status() return redis.call('HGET', KEYS[1], 'status') end
local function mine(owner) return status() == 'running' and redis.call('HGET', KEYS[1], 'owner') == owner end
local function move(to)
  redis.call('HSET', KEYS[1], 'status', to)
  redis.call('HINCRBY', KEYS[1], 'version', 1)
  redis.call('PUBLISH', ARGV[2], ARGV[1] .. ' ' .. to)
end
local function finish(to, failure)
  redis.call('HSET', KEYS[1], 'finished_at', ARGV[3])
  redis.call('HDEL', KEYS[1], 'owner')
  if failure ~= '' then redis.call('HSET', KEYS[1], 'error', failure) end
  for key = 1, 3 do redis.call('EXPIRE', KEYS[key], ARGV[4]) end
  redis.call('SET', KEYS[4], '', 'EX', ARGV[4] + ARGV[5])
  move(to)
end
"""

START = (
    _COMMON
    + """
-- ARGV[6] owner, ARGV[7] losses that end the job, ARGV[8] the error it then has.
local now = status()
if not now then return 'missing' end
if now == 'running' then
  -- The same start asked again because its answer was lost on the way.
  if mine(ARGV[6]) then return 'started' end
  if redis.call('HGET', KEYS[1], 'cancel') == '1' then finish('cancelled', '') return 'cancelled' end
  if redis.call('HINCRBY', KEYS[1], 'losses', 1) >= tonumber(ARGV[7]) then
    finish('failed', ARGV[8])
    return 'failed'
  end
elseif now ~= 'queued' then
  return now
end
redis.call('HSET', KEYS[1], 'owner', ARGV[6], 'started_at', ARGV[3])
redis.call('HDEL', KEYS[1], 'progress')
redis.call('HINCRBY', KEYS[1], 'attempts', 1)
move('running')
return 'started'
"""
)
"""Make the job running and this solve its owner; answers ``started``, ``missing`` or the final status."""

REPORT = (
    _COMMON
    + """
-- ARGV[6] owner, ARGV[7] progress as JSON or '' for nothing new.
if not mine(ARGV[6]) then return 'lost' end
if ARGV[7] ~= '' then
  redis.call('HSET', KEYS[1], 'progress', ARGV[7])
  redis.call('HINCRBY', KEYS[1], 'version', 1)
end
if redis.call('HGET', KEYS[1], 'cancel') == '1' then return 'cancel' end
return 'go'
"""
)
"""Write progress; answers ``go``, ``cancel`` (somebody asks to stop) or ``lost`` (not ours any more)."""

FINISH = (
    _COMMON
    + """
-- ARGV[6] owner, ARGV[7] final status, ARGV[8] error as JSON or '', ARGV[9] compressed result or ''.
if not mine(ARGV[6]) then return 0 end
if ARGV[9] ~= '' then
  redis.call('SET', KEYS[3], ARGV[9])
  redis.call('HSET', KEYS[1], 'has_result', '1')
end
finish(ARGV[7], ARGV[8])
return 1
"""
)
"""Write the end of a job, once: 1 if this solve owned it, 0 if nothing was written."""

FAIL = (
    _COMMON
    + """
-- ARGV[6] error as JSON.
if status() ~= 'running' then return 0 end
finish('failed', ARGV[6])
return 1
"""
)
"""End a running job whose child was killed: for the worker's main process, which does not know the owner."""

HAND_BACK = (
    _COMMON
    + """
if status() ~= 'running' then return 0 end
if redis.call('HGET', KEYS[1], 'cancel') == '1' then finish('cancelled', '') return 1 end
redis.call('HDEL', KEYS[1], 'owner', 'started_at', 'progress')
move('queued')
return 1
"""
)
"""Put a running job back to queued: for the main process of a worker that returns the message and ends."""

CANCEL = (
    _COMMON
    + """
local now = status()
if now == 'queued' then finish('cancelled', '') end
if now == 'running' and redis.call('HGET', KEYS[1], 'cancel') ~= '1' then
  redis.call('HSET', KEYS[1], 'cancel', '1')
  redis.call('HINCRBY', KEYS[1], 'version', 1)
end
return status()
"""
)
"""End a queued job, ask a running one to stop, leave an ended one alone; answers the status or nothing."""

ERASE = (
    _COMMON
    + """
-- KEYS[5] the index.
local now = status()
if not now or now == 'queued' or now == 'running' then return now end
redis.call('DEL', KEYS[1], KEYS[2], KEYS[3])
redis.call('ZREM', KEYS[5], ARGV[1])
redis.call('SET', KEYS[4], '', 'EX', ARGV[5])
return 'erased'
"""
)
"""Erase an ended job; answers ``erased``, or the status that forbids it, or nothing where there is no job."""
