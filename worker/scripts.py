"""The changes of a job that must be one step for everyone: Lua scripts run inside the server.

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
local function note(event, data, word)
  redis.call('XADD', KEYS[6], 'MAXLEN', '~', 1000, '*', 'event', event, 'data', data)
  redis.call('PUBLISH', ARGV[2], ARGV[1] .. ' ' .. (word or event))
end
local function note_status()
  local record = redis.call('HMGET', KEYS[1], 'status', 'attempts', 'cancel', 'error')
  note('status', '{"status":"' .. record[1] .. '","attempts":' .. (record[2] or 0) .. ',"cancel_requested":'
    .. tostring(record[3] == '1') .. ',"error":' .. (record[4] or 'null') .. ',"at":' .. ARGV[3] .. '}',
    record[1] ~= 'queued' and record[1] ~= 'running' and 'end')
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

ADD = (
    _COMMON
    + """
-- KEYS[12] index of all jobs, KEYS[13] of the project, KEYS[14] its active jobs, KEYS[15] projects, KEYS[16]
-- hooks, KEYS[17] where messages wait.
-- ARGV[7] compressed document, ARGV[8] the first event, ARGV[9] message or '', ARGV[10] most active jobs of
-- the project or '' for any number, ARGV[11] most waiting jobs of all, ARGV[12] on names and values of the
-- record.
if status() then return 1 end
if ARGV[10] ~= '' then
  local waiting = 0
  for number = 9, 11 do waiting = waiting + redis.call('ZCARD', KEYS[number]) end
  if redis.call('SCARD', KEYS[14]) >= tonumber(ARGV[10]) or waiting >= tonumber(ARGV[11]) then return 0 end
end
redis.call('HSET', KEYS[1], unpack(ARGV, 12))
redis.call('SET', KEYS[2], ARGV[7])
redis.call('ZADD', KEYS[12], 0, ARGV[1])
redis.call('ZADD', KEYS[13], 0, ARGV[1])
redis.call('SADD', KEYS[14], ARGV[1])
redis.call('SADD', KEYS[15], project())
local record = redis.call('HMGET', KEYS[1], 'created_at', 'deadline_at', 'webhook')
redis.call('ZADD', queued(), record[1], ARGV[1])
if record[2] then redis.call('ZADD', KEYS[8], record[2], ARGV[1]) end
if record[3] then redis.call('ZADD', KEYS[16], record[1], ARGV[1]) end
redis.call('XADD', KEYS[6], '*', 'event', 'status', 'data', ARGV[8])
if ARGV[9] ~= '' then redis.call('LPUSH', KEYS[17], ARGV[9]) end
return 1
"""
)
"""Record a new job, and publish its message: 1 if that is done, or was before, 0 if there are too many."""

START = (
    _COMMON
    + """
-- ARGV[7] owner, ARGV[8] losses that end the job, ARGV[9] the error it then has, ARGV[10] 1 if the message
-- was delivered before, ARGV[11] the error of a job whose deadline has passed.
if ARGV[10] == '1' then count('redeliveries') end
local function assignment() return {redis.call('HGETALL', KEYS[1]), redis.call('GET', KEYS[2])} end
local now = status()
if not now then return 'missing' end
if now == 'running' then
  -- The same start asked again because its answer was lost on the way.
  if mine(ARGV[7]) then return assignment() end
  if held() then
    count('duplicates')
    return 'busy'
  end
  if not survives(ARGV[8], ARGV[9]) then return status() end
elseif now ~= 'queued' then
  return now
end
if overdue() then
  finish('failed', ARGV[11])
  return status()
end
redis.call('HSET', KEYS[1], 'owner', ARGV[7], 'started_at', ARGV[3])
redis.call('HDEL', KEYS[1], 'progress')
redis.call('HINCRBY', KEYS[1], 'attempts', 1)
count('attempts')
move('running')
return assignment()
"""
)
"""Make the job running and this solve its owner.

Answers the record and the document, else ``missing``, ``busy`` (another solve owns the job) or the final
status.
"""

REPORT = (
    _COMMON
    + """
-- ARGV[7] owner, ARGV[8] progress as JSON or '' for nothing new, ARGV[9] all that is told of it.
if not mine(ARGV[7]) then return 'lost' end
local left = tonumber(redis.call('ZSCORE', KEYS[5], ARGV[1]) or 0) - clock()
if left < ARGV[6] / 2 then lend(tonumber(ARGV[6])) end
if ARGV[8] ~= '' then
  redis.call('HSET', KEYS[1], 'progress', ARGV[8])
  redis.call('HINCRBY', KEYS[1], 'version', 1)
  note('progress', ARGV[9])
end
if redis.call('HGET', KEYS[1], 'cancel') == '1' then return 'cancel' end
return 'go'
"""
)
"""Write progress and renew the lease when half of it is over.

Answers ``go``, ``cancel`` (somebody asks to stop) or ``lost`` (not ours any more).
"""

FINISH = (
    _COMMON
    + """
-- KEYS[12] where the job is to be found by what it answers, if it may be.
-- ARGV[7] owner, ARGV[8] final status, ARGV[9] error as JSON or '', ARGV[10] compressed result, or where it
-- is (`worker.results`), or '', ARGV[11] how many bytes it has.
if not mine(ARGV[7]) then return 0 end
if ARGV[10] ~= '' then keep(ARGV[10], ARGV[11]) end
if KEYS[12] then redis.call('SET', KEYS[12], ARGV[1], 'EX', ARGV[4]) end
finish(ARGV[8], ARGV[9])
return 1
"""
)
"""Write the end of a job, once: 1 if this solve owned it, 0 if nothing was written."""

ANSWER = (
    _COMMON
    + """
-- ARGV[7] id of the earlier job, ARGV[8] compressed result, or where it is, ARGV[9] how many bytes it has.
if status() ~= 'queued' then return 0 end
redis.call('HSET', KEYS[1], 'reused_from', ARGV[7])
keep(ARGV[8], ARGV[9])
count('reused')
finish('succeeded', '')
return 1
"""
)
"""End a waiting job with the answer of an earlier one: 1 if it waited, 0 if nothing was written."""

FAIL = (
    _COMMON
    + """
-- ARGV[7] how the owner's word begins, ARGV[8] error as JSON.
if not owned_by(ARGV[7]) then return 0 end
finish('failed', ARGV[8])
return 1
"""
)
"""End a running job whose child was killed: for the worker's main process, which does not know the word."""

LOSE = (
    _COMMON
    + """
-- ARGV[7] how the owner's word begins, ARGV[8] seconds beyond max_seconds that a solve may take,
-- ARGV[9] the error of one that took longer.
if not owned_by(ARGV[7]) then return 0 end
local record = redis.call('HMGET', KEYS[1], 'started_at', 'max_seconds')
if ARGV[3] - record[1] >= record[2] + ARGV[8] then
  finish('failed', ARGV[9])
else
  redis.call('ZADD', KEYS[5], 0, ARGV[1])
end
return 1
"""
)
"""End the lease of a child that has died, and the job if it died because its time was over."""

HAND_BACK = (
    _COMMON
    + """
-- ARGV[7] how the owner's word begins.
if not owned_by(ARGV[7]) then return 0 end
if redis.call('HGET', KEYS[1], 'cancel') == '1' then finish('cancelled', '') else requeue() end
return 1
"""
)
"""Put a running job back to queued: for the main process of a worker that returns the message and ends."""

RECLAIM = (
    _COMMON
    + """
-- ARGV[7] losses that end the job, ARGV[8] the error it then has.
if status() ~= 'running' then
  redis.call('ZREM', KEYS[5], ARGV[1])
  return 0
end
if held() or not survives(ARGV[7], ARGV[8]) then return 0 end
count('reclaimed')
requeue()
return 1
"""
)
"""Put a running job that nobody owns any more back to queued, 1 if it is to be published again."""

GIVE_UP = (
    _COMMON
    + """
-- ARGV[7] the error.
local now = status()
if now == 'running' then return 0 end
if now == 'queued' and overdue() then
  finish('failed', ARGV[7])
  return 1
end
redis.call('ZREM', KEYS[8], ARGV[1])
return 0
"""
)
"""End a waiting job whose deadline has passed; a running one ends by itself."""

CANCEL = (
    _COMMON
    + """
local now = status()
if now == 'queued' then finish('cancelled', '') end
if now == 'running' and redis.call('HGET', KEYS[1], 'cancel') ~= '1' then
  redis.call('HSET', KEYS[1], 'cancel', '1')
  redis.call('HINCRBY', KEYS[1], 'version', 1)
  note_status()
end
return status()
"""
)
"""End a queued job, ask a running one to stop, leave an ended one alone; answers the status or nothing."""

PIN = (
    _COMMON
    + """
-- ARGV[7] 1 to keep the job until it is erased, 0 to keep it for its time from now on.
local now = status()
local pinned = redis.call('HGET', KEYS[1], 'pinned') or '0'
if not now or pinned == ARGV[7] then return now end
redis.call('HSET', KEYS[1], 'pinned', ARGV[7])
redis.call('HINCRBY', KEYS[1], 'version', 1)
if ARGV[7] == '1' then
  redis.call('HDEL', KEYS[1], 'expires_at')
  for _, key in ipairs(parts) do redis.call('PERSIST', key) end
elseif now ~= 'queued' and now ~= 'running' then
  expire()
end
return now
"""
)
"""Take an ended job's time of keeping away or give it one; answers the status or nothing."""

ERASE = (
    _COMMON
    + """
-- KEYS[12] the index.
local now = status()
if not now or now == 'queued' or now == 'running' then return now end
redis.call('SET', KEYS[4], project(), 'EX', ARGV[5])
redis.call('DEL', KEYS[1], KEYS[2], KEYS[3], KEYS[6])
redis.call('ZREM', KEYS[12], ARGV[1])
return 'erased'
"""
)
"""Erase an ended job; answers ``erased``, or the status that forbids it, or nothing where there is no job."""

RENEW = """
-- KEYS = unacked index of the broker, running, counts, then a record for each request.
-- ARGV = lease, then job id, delivery tag and beginning of the owner's word for each request.
local time = redis.call('TIME')
local now = tonumber(time[1]) + tonumber(time[2]) / 1e6
for number = 4, #KEYS do
  local id, tag, worker = ARGV[3 * number - 10], ARGV[3 * number - 9], ARGV[3 * number - 8]
  redis.call('ZADD', KEYS[1], 'XX', string.format('%.3f', now), tag)
  local record = redis.call('HMGET', KEYS[number], 'status', 'owner')
  if record[1] == 'running' and record[2] and string.sub(record[2], 1, #worker) == worker then
    redis.call('ZADD', KEYS[2], 'XX', string.format('%.3f', now + ARGV[1]), id)
  end
end
redis.call('HINCRBY', KEYS[3], 'renewals', #KEYS - 3)
return #KEYS - 3
"""
"""Renew the leases of everything that one worker holds: on the messages, and on the jobs that it solves."""
