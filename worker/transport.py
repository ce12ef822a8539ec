"""How a worker notes at the broker which messages it has fetched."""

from __future__ import annotations

import json
import logging
import time
from typing import Any

from kombu.transport.redis import Channel, QoS, Transport
from kombu.transport.virtual import QoS as PlainQoS
from redis.exceptions import RedisError

logger = logging.getLogger(__name__)


class PromptQoS(QoS):
    """kombu's register of fetched messages, in which a message is noted when a child has taken it.

    kombu notes it, and waits for the answer, before it lets go of it. Nothing rests upon that: between a
    message's being fetched and its note the worker may die at any rate, and the job, which is recorded, is
    then published anew or taken back when its lease is over (`worker.reconciler`). So a message goes to its
    child first and then its note to the broker, whose answer is read before anything else is done about
    messages.
    """

    channel: Any

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._held: tuple[Any, str] | None = None  # The message to be noted, and its delivery tag.
        self._unconfirmed: Any = None  # The connection on which the answers to the last note come.

    def append(self, message: Any, delivery_tag: str) -> None:
        """Hold a message, to be noted soon."""
        self._confirm()
        self._held = message, delivery_tag
        PlainQoS.append(self, message, delivery_tag)

    def ack(self, delivery_tag: str) -> None:
        """Take a message off the register."""
        self._confirm()
        super().ack(delivery_tag)

    def reject(self, delivery_tag: str, requeue: bool = False) -> None:
        """Take a message off the register, and give it back to its queue if wanted."""
        self._confirm()
        super().reject(delivery_tag, requeue)

    def restore_by_tag(self, tag: str, client: Any = None, leftmost: bool = False) -> None:
        """Give a message back to its queue."""
        self._confirm()
        super().restore_by_tag(tag, client, leftmost)

    def note(self) -> None:
        """Tell the broker of the message that is held and not noted yet."""
        held, self._held = self._held, None
        if held is None:
            return
        message, tag = held
        where = message.delivery_info
        text = json.dumps([message._raw, where["exchange"], where["routing_key"]])
        prefix = self.channel.global_keyprefix
        # In this order: half of it is swept away, and does not look like a message that is held.
        commands = [
            ("ZADD", prefix + self.unacked_index_key, time.time(), tag),
            ("HSET", prefix + self.unacked_key, tag, text),
        ]
        connection = None
        try:
            connection = self.channel.pool.get_connection()
            connection.send_packed_command(connection.pack_commands(commands))
            self._unconfirmed = connection
        except RedisError as error:
            self._doubt(connection, error)

    def _confirm(self) -> None:
        """Read what the broker says of the last note."""
        self.note()
        connection, self._unconfirmed = self._unconfirmed, None
        if connection is None:
            return
        try:
            for _ in range(2):
                connection.read_response()
            self.channel.pool.release(connection)
        except RedisError as error:
            self._doubt(connection, error)

    def _doubt(self, connection: Any, error: RedisError) -> None:
        """Tell of a note that may not have been taken, and leave no answer to it behind."""
        logger.warning("the broker may not have noted a message that this worker holds (%s)", error)
        if connection is not None:
            connection.disconnect()
            self.channel.pool.release(connection)


class PromptChannel(Channel):
    """A channel with such a register."""

    QoS = PromptQoS


class PromptTransport(Transport):
    """kombu's Redis transport with such channels."""

    Channel = PromptChannel
