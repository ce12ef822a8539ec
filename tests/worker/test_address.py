import pytest

from worker.address import celery_url, redis_url


@pytest.mark.parametrize(
    ("address", "for_redis", "for_celery"),
    [
        ("redis://host:6379/2", "redis://host:6379/2", "redis://host:6379/2"),
        ("rediss://:word@host/0", *["rediss://:word@host/0?ssl_cert_reqs=required"] * 2),
        ("rediss://host/0?ssl_cert_reqs=CERT_NONE", *["rediss://host/0?ssl_cert_reqs=none"] * 2),
        (
            "rediss://host/0?ssl_ca_certs=/ca.pem",
            *["rediss://host/0?ssl_cert_reqs=required&ssl_ca_certs=%2Fca.pem"] * 2,
        ),
        ("unix:///run/a.sock", "unix:///run/a.sock", "redis+socket:///run/a.sock"),
        ("unix:///run/a.sock?db=3", "unix:///run/a.sock?db=3", "redis+socket:///run/a.sock?virtual_host=3"),
        (
            "redis+socket://:word@/run/a.sock?virtual_host=3",
            "unix://:word@/run/a.sock?db=3",
            "redis+socket://:word@/run/a.sock?virtual_host=3",
        ),
    ],
)
def test_one_address_in_both_spellings(address: str, for_redis: str, for_celery: str) -> None:
    assert redis_url(address) == for_redis
    assert celery_url(address) == for_celery


@pytest.mark.parametrize(
    "address", ["", "host:6379", "redis://", "http://host", "unix://relative.sock", "/a.sock"]
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(ValueError, match="redis://host:6379/0"):
        redis_url(address)


def test_nobody_is_trusted_by_a_slip_of_the_pen() -> None:
    with pytest.raises(ValueError, match="required, optional, none"):
        celery_url("rediss://host/0?ssl_cert_reqs=require")
