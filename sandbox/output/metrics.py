"""metrics.csv: one row a picture, columns with their units."""

import csv
from pathlib import Path
from typing import Any

from sandbox.diagnostics import Measurement
from sandbox.files import append_at
from sandbox.ledger import TERMS
from sandbox.scene.assemble import Assembly

_AXES = "xyz"


class MetricsWriter:
    """Writes a row for every measured instant."""

    def __init__(self, path: Path, assembly: Assembly, size: int = 0) -> None:
        """``size`` are the bytes of an earlier file to go on with; what comes after them there is dropped.

        Raises ValueError where there are not so many.
        """
        cells, tears, ledger = len(assembly.cells) > 0, assembly.spring_set.tears, assembly.scene.diagnostics.ledger
        self._cells, self._tears, self._ledger = cells, tears, ledger
        if size:
            append_at(path, size).close()
        self._file = path.open("a" if size else "w", newline="", encoding="utf-8")
        self._writer: Any = csv.writer(self._file)
        if size:
            return
        axes = _AXES[: assembly.dimension]
        turns = ["z"] if assembly.dimension == 2 else list(axes)
        self._writer.writerow(
            ["frame", "time_s", "kinetic_J", "elastic_J", "gravity_J", "gas_J", "total_J"]
            + [f"momentum_{axis}_kg_m_s" for axis in axes]
            + [f"angular_momentum_{axis}_kg_m2_s" for axis in turns]
            + ["max_strain", "max_speed_m_s", "max_penetration_m"]
            + (["inverted_cells"] if cells else [])
            + (["torn_springs"] if tears else [])
            + ([f"work_{term}_J" for term in TERMS] if ledger else [])
        )

    def write(self, frame: int, time: float, measured: Measurement) -> None:
        """Append the measurement of picture ``frame`` at ``time`` [s]."""
        energy = measured.energy
        numbers = [
            *(time, energy.kinetic, energy.elastic, energy.gravity, energy.gas, energy.total),
            *(*measured.momentum, *measured.angular_momentum),
            *(measured.max_strain, measured.max_speed, measured.max_penetration),
        ]
        if self._cells:
            numbers.append(measured.inverted_cells)
        if self._tears:
            numbers.append(measured.torn)
        if self._ledger and measured.work is not None:
            numbers.extend(measured.work[term] for term in TERMS)
        self._writer.writerow([frame, *(f"{number:.9g}" for number in numbers)])
        self._file.flush()

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._file.tell()

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
