"""How much gas is in a body, and what that means at a volume: an isothermal ideal gas, p = n R T / V.

The gauge pressure p - p0 is often a thousandth of p, and so are the two parts of the energy close to
each other. So the amount of gas is kept as its *excess* e = n R T / V_rest - p0 [Pa], the gauge pressure
that it would have in the volume at rest. With u = V / V_rest - 1, nothing nearly equal is subtracted:

    p - p0 = (e - p0 u) / (1 + u)
    energy = -n R T ln(V / V_rest) + p0 (V - V_rest) = V_rest (p0 (u - ln(1 + u)) - e ln(1 + u))

The energy is the free energy of gas at constant temperature; its gradient is -(p - p0) dV/dx. Sources:
any textbook of thermodynamics; for holes the orifice law C_d A sqrt(2 |p - p0| / rho), from Bernoulli.
"""

from collections.abc import Sequence

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import functions, runtime
from sandbox.scene.surfaces import GAS_CONSTANT, Gas
from sandbox.state import place

FloatArray = NDArray[np.float64]

MOLAR_MASS = 0.02896
"""Molar mass of air [kg/mol]."""
DISCHARGE = 0.6
"""Discharge coefficient of a sharp-edged hole [1]."""
LEAST_VOLUME = 1e-6
"""Fraction of the volume at rest below which a body counts as turned inside out."""
_ORIFICE = DISCHARGE * (2.0 / MOLAR_MASS) ** 0.5
# Beyond this [Pa] a run is lost anyway; a finite number keeps 0 times it 0.
_MOST_GAUGE = 1e30


@ti.data_oriented
class GasAmounts:
    """The gas of G bodies, with P pumps. What the scene lacks (leaks, pumps) is not compiled."""

    def __init__(self, builder: ti.FieldsBuilder, gases: Sequence[Gas]) -> None:
        self.gases = tuple(gases)
        self.count = len(self.gases)
        self.real = runtime.real()
        self.fine = ti.f64
        """Of volumes and amounts, which change by far less in a step than f32 resolves."""
        self.leaks = any(gas.leak > 0.0 for gas in gases)
        self.pump_count = sum(len(gas.pumps) for gas in gases)
        self.pumped = self.pump_count > 0
        fine = self.fine
        self.rest_volume = place(builder, ti.field(fine), self.count)
        self.ambient = place(builder, ti.field(fine), self.count)
        self.leak = place(builder, ti.field(fine), self.count)
        self.thermal = place(builder, ti.field(fine), self.count)
        """R T [J/mol]."""
        self.excess = place(builder, ti.field(fine), 2, self.count)
        """n R T / V_rest - p0 [Pa]: now, and a backup; shape (2, G)."""
        self.pump_done = place(builder, ti.field(fine), 2, self.pump_count)
        """Fraction that every pump has let in so far: now, and a backup; shape (2, P)."""
        if self.pumped:
            self.pump_row = place(builder, ti.field(ti.i32), self.count + 1)
            self.pump_start = place(builder, ti.field(fine), self.pump_count)
            self.pump_end = place(builder, ti.field(fine), self.pump_count)
            self.pump_dose = place(builder, ti.field(fine), self.pump_count)
            """What the pump's whole amount adds to the excess [Pa]."""

    def load(self) -> None:
        """Upload constants, and the amounts that the scene starts with."""
        gases = self.gases
        constants = [[g.rest_volume, g.ambient, g.leak, GAS_CONSTANT * g.temperature] for g in gases]
        self._write_gases(np.array(constants))
        if self.pumped:
            row = np.concatenate([[0], np.cumsum([len(gas.pumps) for gas in gases])]).astype(np.int32)
            pumps = [(start, end, _pressure_at_rest(gas, n)) for gas in gases for start, end, n in gas.pumps]
            self._write_pumps(row, np.array(pumps))
        excess = [_pressure_at_rest(gas, gas.amount) - gas.ambient for gas in gases]
        self.remember({"gas.excess": np.array(excess), "gas.pumped": np.zeros(self.pump_count)})

    # -- at a volume (1 + u) V_rest -----------------------------------------------------------------

    @ti.func
    def is_inverted(self, u) -> ti.i32:
        """1 where a body's volume is not positive, or next to nothing."""
        return 1.0 + u < LEAST_VOLUME

    @ti.func
    def gauge_at(self, g, u):
        """p - p0 of gas g [Pa]; 0 in a body that is inside out."""
        gauge = (self.excess[0, g] - self.ambient[g] * u) / ti.max(1.0 + u, LEAST_VOLUME)
        gauge = ti.max(-_MOST_GAUGE, ti.min(_MOST_GAUGE, gauge))
        return ti.cast(ti.select(self.is_inverted(u), 0.0, gauge), self.real)

    @ti.func
    def bulk_at(self, g, u):
        """-dp/dV of gas g [Pa/m^3]; 0 in a body that is inside out."""
        ratio = ti.max(1.0 + u, LEAST_VOLUME)
        bulk = (self.excess[0, g] + self.ambient[g]) / (ratio * ratio * self.rest_volume[g])
        return ti.cast(ti.select(self.is_inverted(u), 0.0, ti.min(_MOST_GAUGE, bulk)), self.real)

    @ti.func
    def energy_at(self, g, u):
        """Free energy of gas g [J], 0 in the volume at rest."""
        log, rest = self._logarithm(u)
        return self.rest_volume[g] * (self.ambient[g] * rest - self.excess[0, g] * log)

    @ti.func
    def _logarithm(self, u):
        """ln(1 + u) and u - ln(1 + u), both to rounding for u near 0: ln(1 + u) = 2 artanh(u / (2 + u))."""
        log = ti.cast(functions.log(ti.cast(ti.max(1.0 + u, LEAST_VOLUME), self.real)), self.fine)
        rest = u - log
        if ti.abs(u) < 0.1:
            s = u / (2.0 + u)
            q = s * s
            series = 1.0 / 9.0 + q * (1.0 / 11.0 + q * (1.0 / 13.0 + q / 15.0))
            cubic = 2.0 * s * q * (1.0 / 3.0 + q * (1.0 / 5.0 + q * (1.0 / 7.0 + q * series)))
            log = 2.0 * s + cubic
            rest = u * s - cubic
        return log, rest

    # -- gas that comes and goes --------------------------------------------------------------------

    @ti.func
    def flow(self, g, u, hole, time, dt):
        """Leak, flow through holes of area ``hole`` [m^2], pump, from ``time`` over ``dt`` [s]. Energy gained [J]."""
        before = self.excess[0, g]
        excess = before
        if not self.is_inverted(u):
            # What is here beyond the amount that ambient pressure would hold, as pressure at rest.
            surplus = excess - self.ambient[g] * u
            left = surplus
            if ti.static(self.leaks):
                if left > 0.0:
                    left -= left * self._lost_share(self.leak[g] * dt)
            if hole > 0.0:
                left = self._through_hole(g, 1.0 + u, hole, left, dt)
            excess += left - surplus
        if ti.static(self.pumped):
            for p in range(self.pump_row[g], self.pump_row[g + 1]):
                excess += self.pump_dose[p] * self._let_in(p, time, dt)
        excess = ti.max(excess, -self.ambient[g])
        self.excess[0, g] = excess
        log, _ = self._logarithm(u)
        return -self.rest_volume[g] * (excess - before) * log

    @ti.func
    def _lost_share(self, x):
        """1 - exp(-x), also for x far below the resolution of 1."""
        share = x * (1.0 - x * (1.0 - x / 3.0) / 2.0)
        if x > 1e-3:
            share = ti.cast(1.0 - functions.exp(-ti.cast(x, self.real)), self.fine)
        return share

    @ti.func
    def _through_hole(self, g, ratio, hole, surplus, dt):
        """Surplus [Pa] that is left after ``dt`` of flow through a hole [m^2].

        The flow is as the root of the pressure difference, so the root of the surplus falls evenly, down
        to 0 and no further. That is exact while the upstream pressure changes little.
        """
        upstream = self.ambient[g] + ti.max(surplus, 0.0) / ratio
        rate = _ORIFICE * hole / self.rest_volume[g] * ti.sqrt(upstream * self.thermal[g] / ratio)
        root = ti.max(ti.sqrt(ti.abs(surplus)) - 0.5 * rate * dt, 0.0)
        return ti.select(surplus > 0.0, root * root, -root * root)

    @ti.func
    def _let_in(self, p, time, dt):
        """Fraction of pump p's amount that is due from ``time`` to ``time + dt``."""
        start = self.pump_start[p]
        lasts = self.pump_end[p] - start
        due = ti.min(ti.max((time - start) / lasts, 0.0), 1.0)
        done = self.pump_done[0, p]
        # Counting on from what is done makes the total exact, however times are rounded. More than a
        # step's difference is no rounding: somebody has set the time, and what lies between is skipped.
        if ti.abs(due - done) > (dt + 1e-6 * time) / lasts:
            done = due
        aim = ti.max(done, ti.min(ti.max((time + dt - start) / lasts, 0.0), 1.0))
        self.pump_done[0, p] = aim
        return aim - done

    # -- memory -------------------------------------------------------------------------------------

    def amounts(self) -> FloatArray:
        """Amount of every gas [mol], shape (G,)."""
        return self.memory()["gas.amount"]

    def keep(self) -> None:
        """Copy amounts into a backup."""
        self._copy(0, 1)

    def restore(self) -> None:
        """Copy the backup back."""
        self._copy(1, 0)

    def memory(self) -> dict[str, FloatArray]:
        """Excess [Pa] and amount [mol] of every gas, and fraction that every pump has let in [1].

        The amount is for readers alone: it would not give the excess back to the bit.
        """
        excess, done = np.empty(self.count), np.zeros(self.pump_count)
        self._read(excess, done)
        held = [(e + gas.ambient) / _pressure_at_rest(gas, 1.0) for e, gas in zip(excess, self.gases, strict=True)]
        return {"gas.excess": excess, "gas.pumped": done, "gas.amount": np.array(held)}

    def remember(self, values: dict[str, FloatArray]) -> None:
        """Set amounts from :meth:`memory`."""
        excess, done = (np.asarray(values[name], dtype=np.float64) for name in ("gas.excess", "gas.pumped"))
        self._write(np.ascontiguousarray(excess), np.ascontiguousarray(done))

    @ti.kernel
    def _write_gases(self, constants: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for g in range(self.count):
            self.rest_volume[g] = constants[g, 0]
            self.ambient[g] = constants[g, 1]
            self.leak[g] = constants[g, 2]
            self.thermal[g] = constants[g, 3]

    @ti.kernel
    def _write_pumps(self, row: ti.types.ndarray(), pumps: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for g in range(self.count + 1):
            self.pump_row[g] = row[g]
        ti.loop_config(serialize=True)
        for p in range(self.pump_count):
            self.pump_start[p] = pumps[p, 0]
            self.pump_end[p] = pumps[p, 1]
            self.pump_dose[p] = pumps[p, 2]

    @ti.kernel
    def _read(self, excess: ti.types.ndarray(), done: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for g in range(self.count):
            excess[g] = self.excess[0, g]
        if ti.static(self.pumped):
            ti.loop_config(serialize=True)
            for p in range(self.pump_count):
                done[p] = self.pump_done[0, p]

    @ti.kernel
    def _write(self, excess: ti.types.ndarray(), done: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for g in range(self.count):
            self.excess[0, g] = excess[g]
        if ti.static(self.pumped):
            ti.loop_config(serialize=True)
            for p in range(self.pump_count):
                self.pump_done[0, p] = done[p]

    @ti.kernel
    def _copy(self, source: int, target: int):
        ti.loop_config(serialize=True)
        for g in range(self.count):
            self.excess[target, g] = self.excess[source, g]
        ti.loop_config(serialize=True)
        for p in range(self.pump_count):
            self.pump_done[target, p] = self.pump_done[source, p]


def _pressure_at_rest(gas: Gas, amount: float) -> float:
    """Pressure of an amount [mol] in the volume at rest [Pa]."""
    return amount * GAS_CONSTANT * gas.temperature / gas.rest_volume
