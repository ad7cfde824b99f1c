"""What is kept between calls: traced flows and compiled kernels, the latest few of them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Generic, TypeVar

T = TypeVar("T")


class Kept(Generic[T]):
    """A bounded memory of things by key, safe between threads; what was not asked for longest goes first."""

    def __init__(self, most: int) -> None:
        """Keep `most` of them."""
        self._most = most
        self._things: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The thing of that key, made now if it is not there; threads that ask at once get the same one."""
        with self._lock:
            if key in self._things:
                self._things.move_to_end(key)
                return self._things[key]
        made = make()  # may take seconds, for which threads with other keys need not wait
        with self._lock:
            thing = self._things.setdefault(key, made)
            self._things.move_to_end(key)
            while len(self._things) > self._most:
                self._things.popitem(last=False)
            return thing

    def __len__(self) -> int:
        return len(self._things)

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._things.clear()
