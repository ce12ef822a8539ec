"""API keys and rates as they are remembered."""

from __future__ import annotations

import time

import pytest
from redis import Redis

from worker.keys import KeyStore, KeyUnknown, Scope
from worker.rates import RateLimiter
from worker.settings import QueueSettings


@pytest.fixture
def keys(redis: Redis, queue_settings: QueueSettings) -> KeyStore:
    return KeyStore(redis, queue_settings)


def test_a_key_is_found_and_only_its_digest_is_kept(
    keys: KeyStore, redis: Redis, queue_settings: QueueSettings
) -> None:
    assert not keys.any()
    record, key = keys.create("Ada", "slews", [Scope.READ])
    assert key.startswith(f"{record.prefix}_")
    assert len(key) == 60
    assert keys.find(key) == record
    assert keys.list() == [record]
    assert keys.any()
    stored = redis.hgetall(f"{queue_settings.prefix}keys")
    assert key.rpartition("_")[2] not in str(stored)
    assert key.encode() not in b"".join(redis.dump(name) or b"" for name in redis.scan_iter(count=1000))


def test_what_is_no_key_opens_nothing(keys: KeyStore) -> None:
    _, key = keys.create("Ada", "slews", [Scope.READ])
    last = "a" if key[-1] != "a" else "b"
    for wrong in ("", "x", key[:-1], key + "a", key[:-1] + last, f"ond_{'0' * 12}_{key[17:]}", key.upper()):
        assert keys.find(wrong) is None, wrong


def test_a_revoked_key_opens_nothing_and_is_remembered(keys: KeyStore) -> None:
    record, key = keys.create("Ada", "slews", [Scope.READ])
    revoked = keys.revoke(record.id)
    assert keys.revoke(record.prefix).revoked_at == revoked.revoked_at
    assert keys.find(key) is None
    assert [found.revoked_at is not None for found in keys.list()] == [True]
    assert keys.any()
    with pytest.raises(KeyUnknown):
        keys.revoke("nobody")


def test_a_key_expires(keys: KeyStore) -> None:
    _, key = keys.create("Ada", "slews", [Scope.READ], expires_at=time.time() + 0.2)
    assert keys.find(key) is not None
    time.sleep(0.25)
    assert keys.find(key) is None


@pytest.mark.parametrize("project", ["", "a b", "-a", "a/b", "a" * 65, "a\n"])
def test_a_project_is_a_plain_word(keys: KeyStore, project: str) -> None:
    with pytest.raises(ValueError, match="project"):
        keys.create("Ada", project, [Scope.READ])


def test_a_bucket_empties_and_fills_again(redis: Redis, queue_settings: QueueSettings) -> None:
    rates = RateLimiter(redis, queue_settings)
    limit = 600  # ten a second
    grants = [rates.take("Ada", limit) for _ in range(limit + 30)]
    refused = [grant for grant in grants if not grant.granted]
    assert refused
    assert sum(grant.granted for grant in grants) <= limit + 20
    assert grants[0].remaining == limit - 1
    assert 0 < refused[0].wait <= 0.1
    assert 55 <= refused[0].reset <= 60
    assert rates.take("Grace", limit).granted
    time.sleep(0.25)
    assert rates.take("Ada", limit).granted
