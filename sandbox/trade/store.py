"""Finished rows of a study on disk: an interrupted study goes on where it was."""

import contextlib
import json
import re
from dataclasses import asdict
from pathlib import Path

from sandbox.errors import SceneError
from sandbox.files import replace_when_whole
from sandbox.trade.record import Record
from sandbox.trade.worker import Outcome, Status, Timing

_OURS = re.compile(r"\.?[0-9a-f]{24}(\.time)?\.(json|npz)(\.part)?")
"""Names of its files, whole or not: keys are digests."""


class Store:
    """A folder of outcomes and timings, by the keys of their trials."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SceneError(f"{folder}: cannot be written: {error.strerror or error}") from None

    def outcome(self, key: str) -> Outcome | None:
        """What came of a trial; None where it is not known yet."""
        with contextlib.suppress(OSError, ValueError, KeyError):
            data = json.loads((self.folder / f"{key}.json").read_text(encoding="utf-8"))
            status = Status(data.pop("status"))
            kept = Record.load(self._record(key)) if status is Status.DONE else None
            return Outcome(status=status, record=kept, **data)
        return None

    def keep_outcome(self, key: str, outcome: Outcome) -> None:
        """Write down what came of a trial."""
        if outcome.record is not None:
            outcome.record.save(self._record(key))
        data = {"status": outcome.status, "message": outcome.message, "seconds": outcome.seconds}
        self._write(self.folder / f"{key}.json", data)

    def timing(self, key: str) -> Timing | None:
        """Times of a trial; None where they are not known yet."""
        with contextlib.suppress(OSError, ValueError, TypeError):
            data = json.loads((self.folder / f"{key}.time.json").read_text(encoding="utf-8"))
            return Timing(tuple(map(tuple, data["passes"])), data["fps"], data["message"])
        return None

    def keep_timing(self, key: str, timing: Timing) -> None:
        """Write down the times of a trial."""
        self._write(self.folder / f"{key}.time.json", asdict(timing))

    def clear(self) -> None:
        """Forget everything. What else is in the folder stays, and so does the folder then."""
        with contextlib.suppress(OSError):
            for path in self.folder.iterdir():
                if _OURS.fullmatch(path.name):
                    path.unlink()
            self.folder.rmdir()

    def _record(self, key: str) -> Path:
        return self.folder / f"{key}.npz"

    @staticmethod
    def _write(path: Path, data: object) -> None:
        with replace_when_whole(path) as temporary:
            temporary.write_text(json.dumps(data), encoding="utf-8")
