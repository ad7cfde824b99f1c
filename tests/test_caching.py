"""What is kept: the latest few, one of each key, whoever asks."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

from deltac.caching import LRUCache


def test_what_was_not_asked_for_longest_goes_first() -> None:
    kept: LRUCache[str] = LRUCache(2)
    kept.get("a", lambda: "first a")
    kept.get("b", lambda: "first b")
    kept.get("a", lambda: "second a")
    kept.get("c", lambda: "first c")
    assert len(kept) == 2
    assert kept.get("a", lambda: "second a") == "first a"
    assert kept.get("b", lambda: "second b") == "second b"


def test_threads_that_ask_at_once_share_one() -> None:
    """Both are made, since both found nothing; one of them is handed to both."""
    kept: LRUCache[object] = LRUCache(2)
    both = Barrier(2, timeout=10)

    def make() -> object:
        both.wait()
        return object()

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: kept.get("key", make), range(2))
    assert first is second and len(kept) == 1


def test_another_thread_may_evict_in_between() -> None:
    """While one thread makes its thing another one fills the memory: the first still gets its own."""
    kept: LRUCache[str] = LRUCache(1)

    def make() -> str:
        with ThreadPoolExecutor(1) as pool:  # a lock held meanwhile would wait for ever
            assert pool.submit(kept.get, "other", lambda: "other").result(timeout=10) == "other"
        return "own"

    assert kept.get("own", make) == "own"
    assert kept.get("own", lambda: "again") == "own" and len(kept) == 1
