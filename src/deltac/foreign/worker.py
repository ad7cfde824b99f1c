"""The program of a worker process: takes work from standard input, until that is closed; see `isolation`."""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import warnings
from typing import Any

from deltac.foreign.forking import SERVER, serve
from deltac.foreign.isolation import INSIDE, Failure, answered, loaded, receive, send


def main() -> None:
    """Answer one piece of work after another."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's affair
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what models print goes where messages go
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def read() -> None:
        # Its end tells that the parent is gone, also when that was killed: nobody waits for an answer.
        while (message := receive(sys.stdin.buffer)) is not None:
            messages.put(message)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    warnings.simplefilter("ignore")
    INSIDE.append(True)
    while True:
        message = messages.get()
        answer: Any = answered(lambda message=message: loaded(message)())  # type: ignore[misc]
        try:
            send(answers, answer)
        except OSError:
            os._exit(0)
        except Exception as error:  # before anything was written: it cannot be pickled
            send(answers, Failure("E-INTERNAL", f"no answer can be sent: {error}"))
        del message, answer  # may be large


if __name__ == "__main__":
    if SERVER in sys.argv:
        serve(main)
    main()
