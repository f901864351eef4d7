"""metrics.csv: one row a picture, columns with their units."""

import csv
from pathlib import Path
from typing import Any

from sandbox.diagnostics import Measurement
from sandbox.ledger import TERMS

_AXES = "xyz"


class MetricsWriter:
    """Writes a row for every measured instant."""

    def __init__(self, path: Path, dimension: int, tears: bool = False, ledger: bool = False) -> None:
        """``tears`` and ``ledger`` add columns that only such scenes have."""
        self._tears, self._ledger = tears, ledger
        self._file = path.open("w", newline="", encoding="utf-8")
        self._writer: Any = csv.writer(self._file)
        axes = _AXES[:dimension]
        turns = ["z"] if dimension == 2 else list(axes)
        self._writer.writerow(
            ["frame", "time_s", "kinetic_J", "elastic_J", "gravity_J", "gas_J", "total_J"]
            + [f"momentum_{axis}_kg_m_s" for axis in axes]
            + [f"angular_momentum_{axis}_kg_m2_s" for axis in turns]
            + ["max_strain", "max_speed_m_s", "max_penetration_m"]
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
        if self._ledger and measured.work is not None:
            numbers.extend(measured.work[term] for term in TERMS)
        row = [f"{number:.9g}" for number in numbers]
        if self._tears:
            row.insert(len(row) - (len(TERMS) if self._ledger else 0), str(measured.torn))
        self._writer.writerow([frame, *row])

    def close(self) -> None:
        """Finish the file."""
        self._file.close()
