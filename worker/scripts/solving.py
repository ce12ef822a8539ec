"""What a worker and its solves change; see `worker.scripts.common`."""

from __future__ import annotations

from worker.scripts.common import script

START = script("""
-- ARGV[7] owner, ARGV[8] losses that end the job, ARGV[9] the error it then has, ARGV[10] 1 if the message
-- was delivered before, ARGV[11] the error of a job whose deadline has passed.
if ARGV[10] == '1' then count('redeliveries') end
local function assignment() return {words_of(record), redis.call('GET', KEYS[2])} end
local now = record.status
if not now then return 'missing' end
if now == 'running' then
  -- The same start asked again because its answer was lost on the way.
  if mine(ARGV[7]) then return assignment() end
  if held() then
    count('duplicates')
    return 'busy'
  end
  if not survives(ARGV[8], ARGV[9]) then return record.status end
elseif now ~= 'queued' then
  return now
end
if overdue() then
  finish('failed', ARGV[11])
  return record.status
end
set('owner', ARGV[7])
set('started_at', ARGV[3])
set('attempts', (record.attempts or 0) + 1)
drop('progress')
count('attempts')
move('running')
tell()
return assignment()
""")
"""Make the job running and this solve its owner.

Answers the record and the document, else ``missing``, ``busy`` (another solve owns the job) or the final
status.
"""

REPORT = script("""
-- ARGV[7] owner, ARGV[8] progress as JSON or '' for nothing new, ARGV[9] all that is told of it.
if not mine(ARGV[7]) then return 'lost' end
local left = tonumber(redis.call('ZSCORE', KEYS[5], ARGV[1]) or 0) - clock()
if left < ARGV[6] / 2 then lend(tonumber(ARGV[6])) end
if ARGV[8] ~= '' then
  set('progress', ARGV[8])
  renewed()
  note('progress', ARGV[9])
  tell()
end
if record.cancel == '1' then return 'cancel' end
return 'go'
""")
"""Write progress and renew the lease when half of it is over.

Answers ``go``, ``cancel`` (somebody asks to stop) or ``lost`` (not ours any more).
"""

FINISH = script("""
-- KEYS[12] the key by which the job is found by what it answers, if it may be, but for its project.
-- ARGV[7] owner, ARGV[8] final status, ARGV[9] error as JSON or '', ARGV[10] compressed result, or where it
-- is (`worker.results`), or '', ARGV[11] how many bytes it has, ARGV[12] and ARGV[13] the last progress as
-- REPORT has it.
if not mine(ARGV[7]) then return 0 end
if ARGV[12] ~= '' then
  set('progress', ARGV[12])
  note('progress', ARGV[13])
end
if ARGV[10] ~= '' then keep(ARGV[10], ARGV[11]) end
if KEYS[12] then redis.call('SET', KEYS[12] .. record.project, ARGV[1], 'EX', ARGV[4]) end
finish(ARGV[8], ARGV[9])
return 1
""")
"""Write the end of a job, once: 1 if this solve owned it, 0 if nothing was written."""

FAIL = script("""
-- ARGV[7] how the owner's word begins, ARGV[8] error as JSON.
if not owned_by(ARGV[7]) then return 0 end
finish('failed', ARGV[8])
return 1
""")
"""End a running job whose child was killed: for the worker's main process, which does not know the word."""

LOSE = script("""
-- ARGV[7] how the owner's word begins, ARGV[8] seconds beyond max_seconds that a solve may take,
-- ARGV[9] the error of one that took longer.
if not owned_by(ARGV[7]) then return 0 end
if ARGV[3] - record.started_at >= record.max_seconds + ARGV[8] then
  finish('failed', ARGV[9])
else
  redis.call('ZADD', KEYS[5], 0, ARGV[1])
end
return 1
""")
"""End the lease of a child that has died, and the job if it died because its time was over."""

HAND_BACK = script("""
-- ARGV[7] how the owner's word begins.
if not owned_by(ARGV[7]) then return 0 end
if record.cancel == '1' then finish('cancelled', '') else requeue() end
return 1
""")
"""Put a running job back to queued: for the main process of a worker that returns the message and ends."""

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
