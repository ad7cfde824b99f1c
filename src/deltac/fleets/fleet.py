"""`Plan`: its rows are computed where they are missing, stored and reported, in sweeps and audits alike."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from deltac.calls.progress import Progress
from deltac.errors import ArgumentsError, ProcessLost, UnknownName
from deltac.fleets.execution import Crew, SchedulerLost, dask_crew, execute, local_crew
from deltac.fleets.result import OUTSIDE, Fleet, summarise
from deltac.fleets.rows import Piece, failed_outcome, parquet
from deltac.fleets.spec import Execution
from deltac.fleets.store import RESULTS_FILE, Store
from deltac.foreign.isolation import Failure


class RecomputedWarning(UserWarning):
    """Rows of a folder are of other versions of the programs or of a model, and are made again."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A fleet before it is run: its name, the addresses of all its rows, in order, and its command."""

    kind: ClassVar[str]

    name: str
    addresses: tuple[str, ...]
    command_line: str

    def folder(self) -> Path:
        """Where the results go if nothing is said: the plan's name, and its kind."""
        return Path(f"{self.name.replace('/', '-').replace(':', '-')}.{self.kind}")

    def head(self) -> dict[str, Any]:
        """What the folder says of the plan, for `Store.make`."""
        raise NotImplementedError

    def place(self, address: str) -> int:
        """The place of the row with an address, or with the beginning of one; InputError if there is none."""
        places = [k for k, other in enumerate(self.addresses) if other.startswith(address)]
        if not address or not places:
            raise UnknownName(f"address {address}: the {self.kind} has no such run; see its table")
        return places[0]

    def pieces(self, rows: Sequence[int], workers: int, chunk: int | None) -> Iterator[Piece]:
        """The work for some rows (places in `addresses`, of distinct ones), cut for so many workers."""
        raise NotImplementedError

    def command(self, piece: Piece) -> str:
        """The command that makes the row of a piece alone."""
        return f"{self.command_line} --only {piece.addresses[0]}"

    def write_case(self, address: str, path: Path) -> None:
        """Write the page of one row; InputError if the plan has no such row, or it cannot be made."""
        raise NotImplementedError

    def run(
        self,
        out: str | Path | None,
        execution: Execution,
        *,
        executor: Executor | None = None,
        retry_failed: bool = False,
        progress: Progress | None = None,
        notice: Callable[[str], None] | None = None,
    ) -> Fleet:
        """Do what is not there, and make the table.

        Args:
            out: folder of the results.
            execution: how it is done.
            executor: who does it, in place of what `execution` says.
            retry_failed: try again what was set aside before.
            progress: called with the fraction done, first with what was there before.
            notice: called with what the user should know before the work is done; a `RecomputedWarning`
                without.

        Raises:
            InputError: the folder is in use or cannot be written, the cluster is gone; rows that were made
                stay.
        """
        if executor is not None and execution.scheduler is not None:
            raise ArgumentsError("give executor= or scheduler=, not both")
        store = Store.make(
            self.folder() if out is None else Path(out), self.kind, self.name, **self.head()
        )
        with store.locked():
            before = store.begin()
            done = store.done()
            if retry_failed:
                failed = store.aside()
                store.take_back(failed)
                store.forget(failed)
                done -= failed.keys()
            store.plan(self.addresses)
            others = len(done - set(self.addresses))
            changed = _changed(before, store.head)
            if others and changed:
                message = (
                    f"{store.folder}: {others} rows there are of {changed} and are made again; the old ones "
                    f"stay {OUTSIDE}"
                )
                if notice is None:
                    warnings.warn(message, RecomputedWarning, stacklevel=2)
                else:
                    notice(message)
            missing = [k for k, address in enumerate(self.addresses) if address not in done]
            distinct = list({self.addresses[k]: k for k in reversed(missing)}.values())[::-1]
            count, total = len(self.addresses) - len(missing), len(self.addresses)

            def advance(rows: int) -> None:
                nonlocal count
                count += rows
                if progress is not None:
                    progress(count / total)

            def keep(work: Piece, outcome: Mapping[str, Any]) -> None:
                store.keep(parquet(work.table(outcome)), work.addresses)

            def set_aside(work: Piece, failure: Failure) -> None:
                (address,) = work.addresses
                store.set_aside(
                    address, {"of": work.about(), "reproduce": self.command(work)}, failure
                )
                keep(work, failed_outcome(failure))

            advance(0)
            if missing:
                with _crew(execution, executor, store.folder) as crew:
                    execute(
                        crew,
                        self.pieces(distinct, crew.size, execution.chunk),
                        keep,
                        set_aside,
                        time_limit=execution.time_limit,
                        retries=execution.retries,
                        done=advance,
                    )
            frame = store.table()
            store.write_frame(RESULTS_FILE, frame)
            return summarise(store, frame, total, others)


def _changed(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Which programs or models are others than before, though the plan may be the same; "" if none."""
    old, new = (head.get("versions") or {} for head in (before, now))
    programs = [
        f"{name} {old.get(name, '–')} → {new.get(name, '–')}"
        for name in dict.fromkeys([*old, *new])
        if old.get(name) != new.get(name)
    ]
    if before and programs:
        return f"other versions ({', '.join(programs)})"
    old, new = (head.get("models") or {} for head in (before, now))
    models = [name for name in new if name in old and old[name] != new[name]]
    return f"another version of the model {', '.join(map(repr, models))}" if models else ""


@contextlib.contextmanager
def _crew(execution: Execution, executor: Executor | None, folder: Path) -> Iterator[Crew]:
    """Who does the work; InputError when the cluster is lost meanwhile."""
    if executor is not None:
        size = execution.workers or getattr(executor, "_max_workers", None) or 1
        yield Crew(executor, size)
    elif execution.scheduler is None:
        with local_crew(execution.workers) as crew:
            yield crew
    else:
        try:
            with dask_crew(execution.scheduler) as crew:
                yield crew
        except SchedulerLost as lost:
            raise ProcessLost(
                f"{lost}. The results so far are in {folder}; run it again, with a scheduler or without, "
                "to continue there"
            ) from None
