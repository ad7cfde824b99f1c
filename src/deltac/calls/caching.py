"""What is kept between calls.

The rule: what is kept is an immutable value, and what runs owns its state. What is derived from an immutable
object is kept with that object (`Once`, `functools.cached_property`) and goes when it goes. What is found by
a description is kept by a digest of all that it was made from (`LRUCache`), never by the identity of
something whose contents may change: a function given by a user is looked at anew at every call.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from functools import update_wrapper
from threading import Lock
from typing import Any, Concatenate, Generic, NoReturn, ParamSpec, TypeVar

from deltac.errors import UnknownName, closest

T = TypeVar("T")
K = TypeVar("K")
Owner = TypeVar("Owner", bound="Once")
Key = ParamSpec("Key")


class LRUCache(Generic[T]):
    """A bounded memory of values by key, safe between threads; the one not asked for longest goes first."""

    def __init__(self, most: int) -> None:
        """Keep `most` of them."""
        self._most = most
        self._kept: OrderedDict[Hashable, T] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The value of that key, made now if it is not there; threads that ask at once get the same one."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        value_made = make()  # may take seconds, for which threads with other keys need not wait
        with self._lock:
            value = self._kept.setdefault(key, value_made)
            self._kept.move_to_end(key)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
            return value

    def __len__(self) -> int:
        return len(self._kept)

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._kept.clear()


class Once:
    """A base for immutable objects that keep what is derived from them."""

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What `make` derives from this object, made when it is first asked for by this key.

        `make` may use nothing but this object, the key, and what cannot change. Threads that ask at once may
        each make it; all get the same one.
        """
        values: dict[Hashable, Any] = self.__dict__.setdefault("_derived", {})
        if key not in values:
            values.setdefault(key, make())
        value: T = values[key]
        return value


def derived(make: Callable[Concatenate[Owner, Key], T]) -> Callable[Concatenate[Owner, Key], T]:
    """Keep what a function derives from its first argument, an immutable object, with that object.

    Further arguments tell several results apart: hashable, of values that cannot change.
    """

    def kept(owner: Owner, /, *key: Key.args, **named: Key.kwargs) -> T:
        place = (make, key, tuple(sorted(named.items())))
        return owner.once(place, lambda: make(owner, *key, **named))

    return update_wrapper(kept, make)


class FrozenDict(dict[K, T]):
    """A dict that cannot be changed, as what is kept by its contents must be.

    UnknownName, a KeyError too, for a name that is not there; `what` is what the names are of.
    """

    def __init__(self, values: Mapping[K, T], what: str = "name") -> None:
        super().__init__(values)
        self._what = what

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError(
            "these entries cannot be changed: what was made of them is kept. Make a new object instead, by "
            "Mechanism.with_parameters(...) or dataclasses.replace(...)"
        )

    def __missing__(self, name: Any) -> NoReturn:
        raise UnknownName(f"unknown {self._what} {name!r}{closest(str(name), map(str, self))}")

    __setitem__ = __delitem__ = __ior__ = _refuse
    update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return FrozenDict, (dict(self), self._what)
