"""What is changed of jobs that nobody works on; see `worker.scripts.common`."""

from __future__ import annotations

from worker.scripts.common import script

RECLAIM = script("""
-- ARGV[7] losses that end the job, ARGV[8] the error it then has.
if record.status ~= 'running' then
  redis.call('ZREM', KEYS[5], ARGV[1])
  return 0
end
if held() or not survives(ARGV[7], ARGV[8]) then return 0 end
count('reclaimed')
requeue()
return 1
""")
"""Put a running job that nobody owns any more back to queued, 1 if it is to be published again."""

GIVE_UP = script("""
-- ARGV[7] the error.
if record.status == 'running' then return 0 end
if record.status == 'queued' and overdue() then
  finish('failed', ARGV[7])
  return 1
end
redis.call('ZREM', KEYS[8], ARGV[1])
return 0
""")
"""End a waiting job whose deadline has passed; a running one ends by itself."""
