"""What the scripts about one job share: their keys and arguments, and how a job is changed.

Every script about one job has KEYS = record, document, result, tombstone, running, events, counts, deadlines,
queued (high, normal, low), and ARGV = id, channel, now, retention, memory, lease (how long, in seconds, an
ended job is kept; how long after that it is known to have existed; how long a running job belongs to a solve
that is silent), and its own arguments from ARGV[7] on. ``queued``, one for each priority, ``running`` and
``deadlines`` are sorted sets of job ids: by the time at which the job was published, the time until which its
solve owns it, and the time after which nobody waits for it. ``events`` is the stream of what happened to it,
``counts`` a hash of numbers over all jobs (`worker.counts`).

Whoever solves a job is its ``owner``, a word written at the start: what any other solve of the same job
writes later (a worker given up for lost, a message delivered twice) changes nothing. An owner whose lease is
over is lost, and the job may be started anew. Leases are counted by the server's own clock, and not while
the server itself was away.
"""

from __future__ import annotations

from worker.counts import BUCKETS

COMMON = """
local function status() return redis.call('HGET', KEYS[1], 'status') end
local function queued()
  return ({high = KEYS[9], normal = KEYS[10], low = KEYS[11]})[redis.call('HGET', KEYS[1], 'priority')]
end
local function project() return redis.call('HGET', KEYS[1], 'project') end
local function mine(owner) return status() == 'running' and redis.call('HGET', KEYS[1], 'owner') == owner end
local function owned_by(worker)
  local owner = redis.call('HGET', KEYS[1], 'owner')
  return status() == 'running' and owner and string.sub(owner, 1, #worker) == worker
end
local function clock()
  local time = redis.call('TIME')
  return tonumber(time[1]) + tonumber(time[2]) / 1e6
end
local function lend(seconds)
  redis.call('ZADD', KEYS[5], string.format('%.3f', clock() + seconds), ARGV[1])
end
-- Whether the owner of a running job may still be at work.
local function held()
  local till = tonumber(redis.call('ZSCORE', KEYS[5], ARGV[1]) or 0)
  if till == 0 then return false end
  if clock() < till then return true end
  local uptime = string.match(redis.call('INFO', 'server'), 'uptime_in_seconds:(%d+)')
  return tonumber(uptime) < tonumber(ARGV[6])
end
local function count(name, by) redis.call('HINCRBY', KEYS[7], name, by or 1) end
local buckets = {BUCKETS}
local function count_end(to, failure)
  local record = redis.call('HMGET', KEYS[1], 'method', 'started_at')
  local outcome = failure == '' and to or cjson.decode(failure).type
  count('ended ' .. record[1] .. ' ' .. to .. ' ' .. outcome)
  if not record[2] then return end
  local seconds = math.max(0, ARGV[3] - record[2])
  local name = record[1] .. ' ' .. outcome
  redis.call('HINCRBYFLOAT', KEYS[7], 'seconds ' .. name, string.format('%.6f', seconds))
  for _, bucket in ipairs(buckets) do
    if seconds <= bucket then return count('within ' .. name .. ' ' .. bucket) end
  end
  count('within ' .. name .. ' +Inf')
end
local function note(event, data)
  redis.call('XADD', KEYS[6], 'MAXLEN', '~', 1000, '*', 'event', event, 'data', data)
end
local function tell(word) redis.call('PUBLISH', ARGV[2], ARGV[1] .. ' ' .. word) end
local function note_status()
  local record = redis.call('HMGET', KEYS[1], 'status', 'attempts', 'cancel', 'error')
  note('status', '{"status":"' .. record[1] .. '","attempts":' .. (record[2] or 0) .. ',"cancel_requested":'
    .. tostring(record[3] == '1') .. ',"error":' .. (record[4] or 'null') .. ',"at":' .. ARGV[3] .. '}')
end
local function move(to)
  redis.call('HSET', KEYS[1], 'status', to)
  redis.call('HINCRBY', KEYS[1], 'version', 1)
  redis.call('ZREM', queued(), ARGV[1])
  redis.call('ZREM', KEYS[5], ARGV[1])
  if to == 'queued' then redis.call('ZADD', queued(), redis.call('HGET', KEYS[1], 'created_at'), ARGV[1]) end
  if to == 'running' then lend(tonumber(ARGV[6])) end
  note_status()
end
local parts = {KEYS[1], KEYS[2], KEYS[3], KEYS[6]}
-- Keep an ended job for its time, and then only that it existed.
local function expire()
  redis.call('HSET', KEYS[1], 'expires_at', ARGV[3] + ARGV[4])
  for _, key in ipairs(parts) do redis.call('EXPIRE', key, ARGV[4]) end
  redis.call('SET', KEYS[4], project(), 'EX', ARGV[4] + ARGV[5])
end
local function finish(to, failure)
  count_end(to, failure)
  redis.call('HSET', KEYS[1], 'finished_at', ARGV[3])
  redis.call('HDEL', KEYS[1], 'owner')
  redis.call('ZREM', KEYS[8], ARGV[1])
  if failure ~= '' then redis.call('HSET', KEYS[1], 'error', failure) end
  move(to)
  if redis.call('HGET', KEYS[1], 'pinned') ~= '1' then expire() end
  -- With the record, so that whoever waits for the end need not ask.
  tell('end ' .. cjson.encode(redis.call('HGETALL', KEYS[1])))
end
local function overdue()
  local deadline = redis.call('HGET', KEYS[1], 'deadline_at')
  return deadline and tonumber(deadline) <= tonumber(ARGV[3])
end
local function keep(result, bytes)
  redis.call('SET', KEYS[3], result)
  redis.call('HSET', KEYS[1], 'has_result', '1')
  note('result', '{"bytes":' .. bytes .. '}')
end
local function requeue()
  redis.call('HDEL', KEYS[1], 'owner', 'started_at', 'progress')
  move('queued')
  tell('status')
end
-- Count a lost worker; false if that was the end of the job.
local function survives(losses, failure)
  if redis.call('HGET', KEYS[1], 'cancel') == '1' then finish('cancelled', '') return false end
  count('losses')
  if redis.call('HINCRBY', KEYS[1], 'losses', 1) < tonumber(losses) then return true end
  finish('failed', failure)
  return false
end
""".replace("BUCKETS", ", ".join(BUCKETS))
"""Stands before the text of every script about one job."""
