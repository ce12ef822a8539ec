"""Connections to addresses that somebody else has chosen (OWASP API7, server-side request forgery).

A name is resolved once, and the connection is made to the address that was looked at, so that it cannot
resolve to another one in between. Only public addresses are allowed, and networks that the operator names.
Nothing is redirected, and no proxy of the environment is used.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterable, Sequence

import httpcore

from solvers.errors import OndeletteError

Network = ipaddress.IPv4Network | ipaddress.IPv6Network
Address = ipaddress.IPv4Address | ipaddress.IPv6Address

# Addresses that stand for others: mapped and translated ones are judged by what they stand for.
_NAT64 = ipaddress.ip_network("64:ff9b::/96")


class AddressRefused(OndeletteError):
    """The host has no address to which a connection is allowed."""


def is_allowed(address: str, networks: Iterable[Network] = ()) -> bool:
    """Tell whether a connection to an IP address is allowed: it is public, or in one of ``networks``."""
    ip: Address = ipaddress.ip_address(address.partition("%")[0])
    if isinstance(ip, ipaddress.IPv6Address):
        if ip.ipv4_mapped is not None:
            ip = ip.ipv4_mapped
        elif ip.sixtofour is not None or ip.teredo is not None or ip in _NAT64:
            return False
    if any(ip in network for network in networks if network.version == ip.version):
        return True
    return ip.is_global and not ip.is_multicast and not ip.is_reserved


def networks_of(texts: Sequence[str]) -> tuple[Network, ...]:
    """Return networks from texts such as ``10.1.0.0/16``; raises ValueError."""
    return tuple(ipaddress.ip_network(text) for text in texts)


class VettedBackend(httpcore.NetworkBackend):
    """Connects to allowed addresses only."""

    def __init__(self, networks: Sequence[Network] = ()) -> None:
        self._networks = networks
        self._inner = httpcore.SyncBackend()

    def connect_tcp(
        self,
        host: str,
        port: int,
        timeout: float | None = None,
        local_address: str | None = None,
        socket_options: Iterable[httpcore.SOCKET_OPTION] | None = None,
    ) -> httpcore.NetworkStream:
        """Resolve, look, connect; raises AddressRefused, and httpcore.ConnectError for an unknown name."""
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except (socket.gaierror, UnicodeError) as error:
            raise httpcore.ConnectError(str(error)) from error
        for *_, address in found:
            if is_allowed(str(address[0]), self._networks):
                return self._inner.connect_tcp(str(address[0]), port, timeout, local_address, socket_options)
        raise AddressRefused(f"{host} has no public address")

    def connect_unix_socket(
        self,
        path: str,
        timeout: float | None = None,
        socket_options: Iterable[httpcore.SOCKET_OPTION] | None = None,
    ) -> httpcore.NetworkStream:
        """Refuse."""
        raise AddressRefused("sockets of this machine are out of reach")


def post(
    url: str, body: bytes, headers: Sequence[tuple[str, str]], networks: Sequence[Network], seconds: float
) -> int:
    """Post to an address and return the status of the answer, which is not read.

    Each of connecting, sending and waiting may take ``seconds``. Raises AddressRefused and the errors of
    httpcore.
    """
    timeout = dict.fromkeys(("connect", "read", "write", "pool"), seconds)
    with (
        httpcore.ConnectionPool(network_backend=VettedBackend(networks), max_connections=1) as pool,
        pool.stream("POST", url, headers=headers, content=body, extensions={"timeout": timeout}) as response,
    ):
        return response.status
