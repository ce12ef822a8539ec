"""The order in which a worker asks the queues."""

from collections import Counter

from worker.priorities import Turns, queue_of
from worker.records import Priority

ALL = [queue_of(priority) for priority in Priority]


def served(turns: Turns, waiting: dict[Priority, int], fetches: int) -> list[Priority]:
    """The priorities of the messages fetched one after the other from queues of so many messages."""
    left = {queue_of(priority): number for priority, number in waiting.items()}
    found = []
    for _ in range(fetches):
        name = next(name for name in turns.consume(3) if left.get(name))
        left[name] -= 1
        turns.rotate(name)
        found.append(Priority(name.removeprefix("solve.")))
    return found


def test_urgent_jobs_get_most_and_nobody_nothing() -> None:
    order = served(Turns(ALL), dict.fromkeys(Priority, 100), 70)
    assert Counter(order) == {Priority.HIGH: 40, Priority.NORMAL: 20, Priority.LOW: 10}
    assert all(Priority.LOW in order[start : start + 7] for start in range(60))


def test_a_turn_that_is_not_taken_goes_to_the_most_urgent_job() -> None:
    assert served(Turns(ALL), {Priority.NORMAL: 3, Priority.LOW: 4}, 7).count(Priority.LOW) == 4
    first = served(Turns(ALL), {Priority.HIGH: 5, Priority.LOW: 5}, 5)
    assert first == [Priority.HIGH, Priority.HIGH, Priority.HIGH, Priority.LOW, Priority.HIGH]
    assert served(Turns(ALL), {Priority.LOW: 9}, 9) == [Priority.LOW] * 9


def test_only_queues_that_are_consumed_are_asked() -> None:
    turns = Turns()
    assert turns.consume(3) == []
    turns.update([queue_of(Priority.LOW)])
    assert turns.consume(1) == [queue_of(Priority.LOW)]
