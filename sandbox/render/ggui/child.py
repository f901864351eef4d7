"""The drawing process itself: ``python -m sandbox.render.ggui.child``, with messages on standard input and output."""

import os
import pickle
import signal
import sys
import traceback
from typing import Any


def main() -> None:
    """Draw what is asked for until there is nobody to ask."""
    # Ctrl-C reaches everybody at a terminal; when to end is the parent's business.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    # What libraries print must not get between the messages.
    os.dup2(2, 1)
    code = 0
    try:
        _serve(sys.stdin.buffer, answers)
    except (EOFError, BrokenPipeError):
        pass  # the parent is gone
    except BaseException:
        traceback.print_exc()
        code = 1
    # Drivers crash when Python takes windows apart in an order of its own.
    sys.stderr.flush()
    os._exit(code)


def _serve(requests: Any, answers: Any) -> None:
    from sandbox.render.ggui.messages import Ready, Refused
    from sandbox.render.ggui.shared import SharedArrays

    def send(message: Any) -> None:
        pickle.dump(message, answers)
        answers.flush()

    task = pickle.load(requests)
    try:
        from sandbox.render.ggui.stage import Stage

        stage = Stage(task, SharedArrays(task.layout))
    except RuntimeError as error:  # Taichi's, where it finds no driver
        send(Refused(" ".join(str(error).split()) or type(error).__name__))
        return
    except Exception as error:
        send(_failed(error))
        return
    send(Ready())
    try:
        while True:
            send(stage.draw(pickle.load(requests)))
    except (EOFError, BrokenPipeError):
        stage.close()
    except Exception as error:
        traceback.print_exc()
        send(_failed(error))


def _failed(error: Exception) -> Any:
    from sandbox.render.ggui.messages import Failed

    return Failed(f"{type(error).__name__}: {' '.join(str(error).split())}")


if __name__ == "__main__":
    main()
