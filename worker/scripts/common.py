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

_COMMON = """
-- The record, read once; what is changed of it is written once, at the end.
local record, changed, dropped = {}, {}, {}
do
  local words = redis.call('HGETALL', KEYS[1])
  for at = 1, #words, 2 do record[words[at]] = words[at + 1] end
end
local function set(name, value)
  if type(value) == 'number' then value = string.format('%.17g', value) end
  record[name], changed[name] = value, value
end
local function drop(name)
  if record[name] then dropped[#dropped + 1] = name end
  record[name], changed[name] = nil, nil
end
local function words_of(members)
  local words = {}
  for name, value in pairs(members) do
    words[#words + 1] = name
    words[#words + 1] = value
  end
  return words
end
local function save()
  if #dropped > 0 then redis.call('HDEL', KEYS[1], unpack(dropped)) end
  local words = words_of(changed)
  if #words > 0 then redis.call('HSET', KEYS[1], unpack(words)) end
end
local function queued() return ({high = KEYS[9], normal = KEYS[10], low = KEYS[11]})[record.priority] end
local function mine(owner) return record.status == 'running' and record.owner == owner end
local function owned_by(worker)
  return record.status == 'running' and record.owner and string.sub(record.owner, 1, #worker) == worker
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
  local outcome = failure == '' and to or cjson.decode(failure).type
  count('ended ' .. record.method .. ' ' .. to .. ' ' .. outcome)
  if not record.started_at then return end
  local seconds = math.max(0, ARGV[3] - record.started_at)
  local name = record.method .. ' ' .. outcome
  redis.call('HINCRBYFLOAT', KEYS[7], 'seconds ' .. name, string.format('%.6f', seconds))
  for _, bucket in ipairs(buckets) do
    if seconds <= bucket then return count('within ' .. name .. ' ' .. bucket) end
  end
  count('within ' .. name .. ' +Inf')
end
local function note(event, data)
  redis.call('XADD', KEYS[6], 'MAXLEN', '~', 1000, '*', 'event', event, 'data', data)
end
-- Wake those who follow this job, if there are any.
local function tell() redis.call('PUBLISH', ARGV[2] .. ':' .. ARGV[1], '') end
local function note_status()
  note('status', '{"status":"' .. record.status .. '","attempts":' .. (record.attempts or 0)
    .. ',"cancel_requested":' .. tostring(record.cancel == '1')
    .. ',"error":' .. (record.error or 'null') .. ',"at":' .. ARGV[3] .. '}')
end
-- Let whoever has seen the record before know that it is another now.
local function renewed() set('version', record.version + 1) end
local function move(to)
  set('status', to)
  renewed()
  redis.call('ZREM', queued(), ARGV[1])
  redis.call('ZREM', KEYS[5], ARGV[1])
  if to == 'queued' then redis.call('ZADD', queued(), record.created_at, ARGV[1]) end
  if to == 'running' then lend(tonumber(ARGV[6])) end
  note_status()
end
local parts = {KEYS[1], KEYS[2], KEYS[3], KEYS[6]}
-- Keep an ended job for its time, and then only that it existed.
local function expire()
  set('expires_at', ARGV[3] + ARGV[4])
  for _, key in ipairs(parts) do redis.call('EXPIRE', key, ARGV[4]) end
  redis.call('SET', KEYS[4], record.project, 'EX', ARGV[4] + ARGV[5])
end
local function finish(to, failure)
  count_end(to, failure)
  set('finished_at', ARGV[3])
  drop('owner')
  redis.call('ZREM', KEYS[8], ARGV[1])
  if failure ~= '' then set('error', failure) end
  move(to)
  if record.pinned ~= '1' then expire() end
  -- With the record, so that whoever waits for the end need not ask.
  redis.call('PUBLISH', ARGV[2], ARGV[1] .. ' ' .. cjson.encode(words_of(record)))
end
local function overdue() return record.deadline_at and tonumber(record.deadline_at) <= tonumber(ARGV[3]) end
local function keep(result, bytes)
  redis.call('SET', KEYS[3], result)
  set('has_result', '1')
  note('result', '{"bytes":' .. bytes .. '}')
end
local function requeue()
  for _, name in ipairs({'owner', 'started_at', 'progress'}) do drop(name) end
  move('queued')
  tell()
end
-- Count a lost worker; false if that was the end of the job.
local function survives(losses, failure)
  if record.cancel == '1' then finish('cancelled', '') return false end
  count('losses')
  set('losses', (record.losses or 0) + 1)
  if tonumber(record.losses) < tonumber(losses) then return true end
  finish('failed', failure)
  return false
end
""".replace("BUCKETS", ", ".join(BUCKETS))


def script(body: str) -> str:
    """Return the text of a script about one job; what ``body`` returns is its answer."""
    return f"{_COMMON}local function main()\n{body}end\nlocal answer = main()\nsave()\nreturn answer\n"


def script_that_makes_room(body: str) -> str:
    """Return the text of a script about one job that a server without room runs too.

    Such a server (``maxmemory`` of Redis) refuses a script at its first write, if that takes room. Here the
    first one takes none.
    """
    return f"redis.call('ZREM', KEYS[5], '')\n{script(body)}"
