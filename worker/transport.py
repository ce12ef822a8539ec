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
    """kombu's register of fetched messages, in which a note is sent before it is confirmed.

    kombu waits for the broker's answer before it lets go of a message. Nothing rests upon that: between a
    message's being fetched and its note the worker may die at any rate, and the job, which is recorded, is
    then published anew or taken back when its lease is over (`worker.reconciler`). So the message goes to its
    child while the note is on its way, and the answer is read before anything else is done about messages.
    """

    channel: Any

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._unconfirmed: Any = None  # The connection on which the answers to the last note come.

    def append(self, message: Any, delivery_tag: str) -> None:
        """Note that a message is held."""
        self.confirm()
        where = message.delivery_info
        text = json.dumps([message._raw, where["exchange"], where["routing_key"]])
        prefix = self.channel.global_keyprefix
        connection = self.channel.pool.get_connection()
        try:
            # In this order: half of it is swept away, and does not look like a message that is held.
            packed = connection.pack_commands(
                [
                    ("ZADD", prefix + self.unacked_index_key, time.time(), delivery_tag),
                    ("HSET", prefix + self.unacked_key, delivery_tag, text),
                ]
            )
            connection.send_packed_command(packed)
        except RedisError:
            self.channel.pool.release(connection)
            raise
        self._unconfirmed = connection
        PlainQoS.append(self, message, delivery_tag)

    def ack(self, delivery_tag: str) -> None:
        """Take a message off the register."""
        self.confirm()
        super().ack(delivery_tag)

    def reject(self, delivery_tag: str, requeue: bool = False) -> None:
        """Take a message off the register, and give it back to its queue if wanted."""
        self.confirm()
        super().reject(delivery_tag, requeue)

    def restore_by_tag(self, tag: str, client: Any = None, leftmost: bool = False) -> None:
        """Give a message back to its queue."""
        self.confirm()
        super().restore_by_tag(tag, client, leftmost)

    def confirm(self) -> None:
        """Read what the broker said of the last note; a note that was not taken is only told of."""
        connection, self._unconfirmed = self._unconfirmed, None
        if connection is None:
            return
        try:
            for _ in range(2):
                connection.read_response()
        except RedisError as error:
            # Of the two answers one may be left.
            connection.disconnect()
            logger.warning("the broker may not have noted a message that this worker holds (%s)", error)
        finally:
            self.channel.pool.release(connection)


class PromptChannel(Channel):
    """A channel with such a register."""

    QoS = PromptQoS


class PromptTransport(Transport):
    """kombu's Redis transport with such channels."""

    Channel = PromptChannel
