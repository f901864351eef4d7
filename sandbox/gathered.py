"""What a run gathers on its way for its summary: extremes, tears, the balance of energy, and the poster."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox.balance import EnergyBalance
from sandbox.diagnostics import Energy, Measurement

Picture = NDArray[np.uint8]


class Gathered:
    """Follows the measurements and pictures of a run.

    Parameters
    ----------
    first : measurement of the state that it begins with
    begin : time of that [s]
    balances : whether there is a ledger to balance
    """

    def __init__(self, first: Measurement, begin: float, balances: bool) -> None:
        self.begin = begin
        self.energy_start = energies(first.energy)
        self.number = 0
        """Of the last picture."""
        self.pictures = 0
        """Pictures that were drawn."""
        self.max_strain = first.max_strain
        self.most_inverted = first.inverted_cells
        self.torn = first.torn
        self.first_tear: float | None = None
        """Time of the first picture that shows a tear [s]."""
        self.balance = EnergyBalance(first) if balances else None
        self.poster: Picture | None = None
        """The picture of most merit."""
        self.merit = -math.inf

    def add(self, number: int, measured: Measurement, time: float) -> None:
        """Take in the measurement of picture ``number`` at ``time`` [s]."""
        self.number = number
        self.max_strain = max(self.max_strain, measured.max_strain)
        self.most_inverted = max(self.most_inverted, measured.inverted_cells)
        if measured.torn > self.torn:
            self.first_tear = time if self.first_tear is None else self.first_tear
            self.torn = measured.torn
        if self.balance is not None:
            self.balance.add(measured)

    def show(self, picture: Picture, merit: float) -> None:
        """Take in a picture."""
        self.pictures += 1
        if merit > self.merit:
            self.poster, self.merit = picture, merit

    def plain(self) -> dict[str, Any]:
        """All but the poster as plain data, for :meth:`of`."""
        names = ("begin", "energy_start", "number", "pictures", "max_strain", "most_inverted", "torn", "first_tear")
        balance = None if self.balance is None else self.balance.memory()
        merit = self.merit if math.isfinite(self.merit) else None
        return {name: getattr(self, name) for name in names} | {"balance": balance, "merit": merit}

    @classmethod
    def of(cls, plain: dict[str, Any], poster: Picture | None, last: Measurement) -> "Gathered":
        """What gave this, when ``last`` was measured. Raises KeyError or TypeError where nothing can have."""
        found = cls(last, float(plain["begin"]), balances=False)
        for name in ("energy_start", "number", "pictures", "max_strain", "most_inverted", "torn", "first_tear"):
            setattr(found, name, plain[name])
        moved_and_first = plain["balance"]
        if moved_and_first is not None:
            found.balance = EnergyBalance.resumed(tuple(moved_and_first), last)
        found.poster = poster
        found.merit = -math.inf if plain["merit"] is None else float(plain["merit"])
        return found


def energies(energy: Energy) -> dict[str, float]:
    """Energies by name [J], and their total."""
    return {**asdict(energy), "total": energy.total}
