"""Values by weak keys, bounded in bytes."""

from __future__ import annotations

import gc
import threading

from renderers.weaklru import WeakLru


class Key:
    """Compared by identity, as images and draw lists are."""


def test_a_value_lives_as_long_as_its_key() -> None:
    kept: WeakLru[Key, str] = WeakLru(100)
    key = Key()
    kept.put(key, "value", 10)
    assert kept.get(key) == "value"
    assert kept.get(Key()) is None
    del key
    gc.collect()
    assert (len(kept), kept.nbytes) == (0, 0)


def test_the_least_recently_used_goes_first() -> None:
    kept: WeakLru[Key, int] = WeakLru(100)
    keys = [Key() for _ in range(4)]
    for i in range(3):
        kept.put(keys[i], i, 30)
    assert kept.get(keys[0]) == 0
    kept.put(keys[3], 3, 30)
    assert [kept.get(key) for key in keys] == [0, None, 2, 3]
    assert kept.nbytes == 90


def test_a_value_replaces_the_former_one() -> None:
    kept: WeakLru[Key, str] = WeakLru(100)
    key = Key()
    kept.put(key, "first", 60)
    kept.put(key, "second", 70)
    assert (kept.get(key), len(kept), kept.nbytes) == ("second", 1, 70)


def test_one_larger_than_the_bound_stays_until_the_next() -> None:
    kept: WeakLru[Key, str] = WeakLru(100)
    large, small = Key(), Key()
    kept.put(large, "large", 1000)
    assert kept.get(large) == "large"
    kept.put(small, "small", 1)
    assert (kept.get(large), kept.get(small), kept.nbytes) == (None, "small", 1)


def test_threads_and_dying_keys_leave_the_count_right() -> None:
    kept: WeakLru[Key, int] = WeakLru(500)

    def work() -> None:
        mine = [Key() for _ in range(20)]
        for i in range(2000):
            mine[i % 20] = Key()
            kept.put(mine[i % 20], i, 7)
            kept.get(mine[(i * 7) % 20])

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    gc.collect()
    assert (len(kept), kept.nbytes) == (0, 0)
