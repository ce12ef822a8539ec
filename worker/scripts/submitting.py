"""What those who submit jobs and ask for them change; see `worker.scripts.common`."""

from __future__ import annotations

from worker.scripts.common import script, script_that_makes_room

ADD = script("""
-- KEYS[12] index of all jobs, KEYS[13] of the project, KEYS[14] its active jobs, KEYS[15] projects, KEYS[16]
-- hooks, KEYS[17] where messages wait.
-- ARGV[7] compressed document, ARGV[8] the first event, ARGV[9] message or '', ARGV[10] most active jobs of
-- the project or '' for any number, ARGV[11] most waiting jobs of all, ARGV[12] on names and values of the
-- record.
if record.status then return 1 end
if ARGV[10] ~= '' then
  local waiting = 0
  for number = 9, 11 do waiting = waiting + redis.call('ZCARD', KEYS[number]) end
  if redis.call('SCARD', KEYS[14]) >= tonumber(ARGV[10]) or waiting >= tonumber(ARGV[11]) then return 0 end
end
for at = 12, #ARGV, 2 do set(ARGV[at], ARGV[at + 1]) end
redis.call('SET', KEYS[2], ARGV[7])
redis.call('ZADD', KEYS[12], 0, ARGV[1])
redis.call('ZADD', KEYS[13], 0, ARGV[1])
redis.call('SADD', KEYS[14], ARGV[1])
redis.call('SADD', KEYS[15], record.project)
redis.call('ZADD', queued(), record.created_at, ARGV[1])
if record.deadline_at then redis.call('ZADD', KEYS[8], record.deadline_at, ARGV[1]) end
if record.webhook then redis.call('ZADD', KEYS[16], record.created_at, ARGV[1]) end
redis.call('XADD', KEYS[6], '*', 'event', 'status', 'data', ARGV[8])
if ARGV[9] ~= '' then redis.call('LPUSH', KEYS[17], ARGV[9]) end
return 1
""")
"""Record a new job, and publish its message: 1 if that is done, or was before, 0 if there are too many."""

ANSWER = script("""
-- ARGV[7] id of the earlier job, ARGV[8] compressed result, or where it is, ARGV[9] how many bytes it has.
if record.status ~= 'queued' then return 0 end
set('reused_from', ARGV[7])
keep(ARGV[8], ARGV[9])
count('reused')
finish('succeeded', '')
return 1
""")
"""End a waiting job with the answer of an earlier one: 1 if it waited, 0 if nothing was written."""

CANCEL = script_that_makes_room("""
if record.status == 'queued' then
  finish('cancelled', '')
elseif record.status == 'running' and record.cancel ~= '1' then
  set('cancel', '1')
  renewed()
  note_status()
  tell()
end
return record.status
""")
"""End a queued job, ask a running one to stop, leave an ended one alone; answers the status or nothing."""

PIN = script("""
-- ARGV[7] 1 to keep the job until it is erased, 0 to keep it for its time from now on.
local now = record.status
if not now or (record.pinned or '0') == ARGV[7] then return now end
set('pinned', ARGV[7])
renewed()
if ARGV[7] == '1' then
  drop('expires_at')
  for _, key in ipairs(parts) do redis.call('PERSIST', key) end
elseif now ~= 'queued' and now ~= 'running' then
  expire()
end
return now
""")
"""Take an ended job's time of keeping away or give it one; answers the status or nothing."""

ERASE = script_that_makes_room("""
-- KEYS[12] the index.
local now = record.status
if not now or now == 'queued' or now == 'running' then return now end
redis.call('SET', KEYS[4], record.project, 'EX', ARGV[5])
redis.call('DEL', KEYS[1], KEYS[2], KEYS[3], KEYS[6])
redis.call('ZREM', KEYS[12], ARGV[1])
return 'erased'
""")
"""Erase an ended job; answers ``erased``, or the status that forbids it, or nothing where there is no job."""
