"""The cache: eviction, limits and counters."""

import gc
import threading
from concurrent.futures import ThreadPoolExecutor

from hypothesis import given
from hypothesis import strategies as st

from renderers.cache import Cache, CacheBudget, CacheFigures, WeakCache


def test_the_least_recently_used_is_dropped_first() -> None:
    cache: Cache[str, int] = Cache("test", budget=CacheBudget(30))
    for number, name in enumerate("abc"):
        cache.put(name, number, 10)
    assert cache.get("a") == 0
    cache.put("d", 3, 10)
    assert [cache.get(name) for name in "abcd"] == [0, None, 2, 3]
    assert (cache.hits, cache.misses, cache.nbytes, len(cache)) == (4, 1, 30, 3)


def test_values_at_the_limit_are_kept_and_larger_ones_are_not() -> None:
    cache: Cache[str, int] = Cache("test", budget=CacheBudget(30))
    cache.put("a", 1, 30)
    assert cache.get("a") == 1
    cache.put("b", 2, 31)
    assert (cache.get("b"), cache.get("a")) == (None, 1)


def test_replacing_a_value_by_a_too_large_one_drops_both() -> None:
    cache: Cache[str, int] = Cache("test", budget=CacheBudget(30))
    cache.put("a", 1, 30)
    cache.put("a", 2, 31)
    assert (cache.get("a"), cache.nbytes) == (None, 0)


def test_the_count_is_limited() -> None:
    cache: Cache[int, int] = Cache("test", max_count=2, budget=CacheBudget(100))
    for number in range(3):
        cache.put(number, number, 1)
    assert [cache.get(number) for number in range(3)] == [None, 1, 2]


def test_caches_of_a_budget_share_its_limit_and_evict_the_oldest_of_all() -> None:
    budget = CacheBudget(30)
    first: Cache[str, int] = Cache("first", budget=budget)
    second: Cache[str, int] = Cache("second", budget=budget)
    first.put("a", 1, 10)
    second.put("b", 2, 10)
    first.put("c", 3, 10)
    assert first.get("a") == 1
    second.put("d", 4, 10)  # evicts b
    second.put("e", 5, 10)  # evicts c
    assert (first.get("a"), first.get("c"), second.get("b")) == (1, None, None)
    assert (second.get("d"), second.get("e")) == (4, 5)
    assert budget.figures() == {"first": CacheFigures(10, 2, 1), "second": CacheFigures(20, 2, 1)}
    del second
    gc.collect()
    assert budget.figures().keys() == {"first"}


def test_evicting_a_value_drops_what_weak_caches_derived_from_it() -> None:
    budget = CacheBudget(100)
    values: Cache[str, Key] = Cache("values", budget=budget)
    derived: Cache[Key, str] = WeakCache("derived", budget=budget)
    values.put("a", Key(), 40)
    key = values.get("a")
    assert key is not None
    derived.put(key, "of a", 40)
    del key
    values.put("b", Key(), 50)
    assert (values.get("a"), len(derived), budget.figures()["derived"].nbytes) == (None, 0, 0)
    assert values.get("b") is not None


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 40)), max_size=40))
def test_nbytes_is_the_sum_of_the_kept_values(puts: list[tuple[int, int]]) -> None:
    cache: Cache[int, int] = Cache("test", budget=CacheBudget(60))
    for key, nbytes in puts:
        cache.put(key, nbytes, nbytes)
        kept = [value for key in range(6) if (value := cache.get(key)) is not None]
        assert cache.nbytes == sum(kept) <= 60
        assert len(cache) == len(kept)
    cache.clear()
    assert (cache.nbytes, len(cache)) == (0, 0)


def test_concurrent_use() -> None:
    cache: Cache[int, int] = Cache("test", budget=CacheBudget(50))

    def work(seed: int) -> None:
        for i in range(500):
            cache.put((seed + i) % 17, i, i % 9)
            cache.get(i % 17)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(8)))
    assert 0 <= cache.nbytes <= 50
    assert cache.hits + cache.misses == 8 * 500


class Key:
    """Compared by identity, as images and draw lists are."""


def test_a_weak_entry_lives_as_long_as_its_key() -> None:
    cache: Cache[Key, str] = WeakCache("test", budget=CacheBudget(100))
    key = Key()
    cache.put(key, "value", 10)
    assert cache.get(key) == "value"
    assert cache.get(Key()) is None
    del key
    gc.collect()
    assert (len(cache), cache.nbytes) == (0, 0)


def test_a_weak_tuple_is_dropped_with_any_of_its_objects() -> None:
    cache: Cache[tuple[Key, ...], str] = WeakCache("test", budget=CacheBudget(100))
    first, second = Key(), Key()
    cache.put((first, second, first), "value", 10)
    assert cache.get((first, second, first)) == "value"
    assert cache.get((second, first, first)) is None
    del second
    gc.collect()
    assert (len(cache), cache.nbytes) == (0, 0)


def test_the_newest_weak_value_is_kept_even_above_the_limit() -> None:
    cache: Cache[Key, str] = WeakCache("test", budget=CacheBudget(100))
    large, small = Key(), Key()
    cache.put(large, "large", 1000)
    assert cache.get(large) == "large"
    cache.put(small, "small", 1)
    assert (cache.get(large), cache.get(small), cache.nbytes) == (None, "small", 1)


def test_nbytes_under_concurrent_use_and_collected_keys() -> None:
    cache: Cache[Key, int] = WeakCache("test", budget=CacheBudget(500))

    def work() -> None:
        mine = [Key() for _ in range(20)]
        for i in range(2000):
            mine[i % 20] = Key()
            cache.put(mine[i % 20], i, 7)
            cache.get(mine[(i * 7) % 20])

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    gc.collect()
    assert (len(cache), cache.nbytes) == (0, 0)
