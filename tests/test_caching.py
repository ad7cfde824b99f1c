"""What is kept: the latest few, one of each key, whoever asks."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest

import deltac as dc
from deltac.calls.caching import FrozenDict, LRUCache, Once, derived


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


def test_what_is_derived_is_kept_with_its_owner() -> None:
    made: list[tuple[str, int]] = []

    @derived
    def twice(owner: Owner, factor: int) -> int:
        made.append((owner.name, factor))
        return 2 * factor

    first, second = Owner("first"), Owner("second")
    assert [twice(first, 1), twice(first, 1), twice(first, 2), twice(second, 1)] == [2, 2, 4, 2]
    assert made == [("first", 1), ("first", 2), ("second", 1)]


class Owner(Once):
    def __init__(self, name: str) -> None:
        self.name = name


def test_a_frozen_dict_is_a_dict_that_refuses_to_change() -> None:
    frozen = FrozenDict({"a": 1.0})
    changes: list[Callable[[], object]] = [
        lambda: frozen.__setitem__("a", 2.0),
        lambda: frozen.update(a=2.0),
        lambda: frozen.pop("a"),
        lambda: frozen.setdefault("b", 2.0),
        frozen.clear,
    ]
    for change in changes:
        with pytest.raises(TypeError, match="with_parameters"):
            change()
    assert frozen == {"a": 1.0} and repr(frozen) == "{'a': 1.0}"
    for twin in (copy.deepcopy(frozen), pickle.loads(pickle.dumps(frozen))):
        assert twin == frozen and type(twin) is FrozenDict


def test_parameters_of_a_mechanism_cannot_be_changed_behind_its_back() -> None:
    """They are part of the digest by which compiled code is kept."""
    mechanism = dc.problems.load("double-pendulum").mechanism
    name = next(iter(mechanism.parameters))
    with pytest.raises(TypeError):
        mechanism.parameters[name] = 1.0  # type: ignore[index]
