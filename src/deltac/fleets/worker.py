"""The program of a worker process: takes work from standard input, until that is closed; see `isolation`."""

from __future__ import annotations

import os
import pickle
import queue
import signal
import sys
import threading
import warnings
from typing import Any

from deltac.fleets.isolation import Failure, answered, receive, send


def main() -> None:
    """Answer one piece of work after another."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's affair
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what models print goes where messages go
    given: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def read() -> None:
        # Its end tells that the parent is gone, also when that was killed: nobody waits for an answer.
        while (message := receive(sys.stdin.buffer)) is not None:
            given.put(message)
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    warnings.simplefilter("ignore")
    while True:
        message = given.get()
        answer: Any = answered(lambda message=message: pickle.loads(message)())  # type: ignore[misc]
        try:
            content = pickle.dumps(answer, pickle.HIGHEST_PROTOCOL)
        except Exception as error:
            content = pickle.dumps(Failure("E-INTERNAL", f"no answer can be sent: {error}"))
        try:
            send(answers, content)
        except OSError:
            os._exit(0)


if __name__ == "__main__":
    main()
