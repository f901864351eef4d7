"""Does the energy ledger close? What was moved between forms of energy, and what nothing explains."""

from dataclasses import asdict

from sandbox.diagnostics import Measurement


class EnergyBalance:
    """Follows measurements of a run with ``diagnostics.ledger`` on."""

    def __init__(self, first: Measurement) -> None:
        self._first = _unexplained(first)
        self._last = first
        self.moved = 0.0
        """Energy that went from one form or term to another, from look to look [J]."""

    def add(self, measured: Measurement) -> None:
        """Take in the next measurement."""
        before, after = _amounts(self._last), _amounts(measured)
        # What leaves one account enters another: half of all changes is what moved.
        self.moved += 0.5 * sum(abs(after[name] - before[name]) for name in after)
        self._last = measured

    @property
    def unexplained(self) -> float:
        """Change of the total energy less all booked work [J]: the error of the scheme."""
        return _unexplained(self._last) - self._first

    def memory(self) -> tuple[float, float]:
        """What :meth:`resumed` takes."""
        return self.moved, self._first

    @classmethod
    def resumed(cls, memory: tuple[float, float], last: Measurement) -> "EnergyBalance":
        """The balance that gave this memory when ``last`` was measured."""
        balance = cls(last)
        balance.moved, balance._first = memory
        return balance


def _amounts(measured: Measurement) -> dict[str, float]:
    return {**asdict(measured.energy), **(measured.work or {})}


def _unexplained(measured: Measurement) -> float:
    return measured.energy.total - sum((measured.work or {}).values())
