"""Gas pressure on closed bodies: (p - p0) times area on every face, in equal parts to its corners.

Summed over a body that is exactly (p - p0) dV/dx, the gradient of the gas's energy. Before the forces,
a pass over blocks of faces measures the volumes, in an order that does not depend on threads.
"""

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.forces.face_fields import FaceFields
from sandbox.forces.gas import GasAmounts
from sandbox.forces.tears import Tears
from sandbox.group_blocks import GroupBlocks, GroupFields
from sandbox.ledger import Ledger
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]


@ti.data_oriented
class Pressure:
    """The gas of all G bodies that have any, on F faces.

    A face with a torn edge is a hole: it still closes the volume, but nothing presses on it, and gas
    flows through. Without leaks, pumps, tears or a ledger, what belongs to them is not compiled.
    """

    term = "gas"
    dissipation_term = "gas_flow"
    damped = False
    linearised = False
    """True with what products need, see :meth:`linearise`."""
    constraint = "gas"
    """As what a scheme that solves constraints takes it."""

    def __init__(
        self,
        builder: ti.FieldsBuilder,
        assembly: Assembly,
        state: ParticleState,
        tears: Tears | None,
        ledger: Ledger | None,
    ) -> None:
        self.state = state
        self.ledger = ledger
        self.amounts_of = GasAmounts(builder, assembly.gases)
        self.gases = self.amounts_of.gases
        self.count = self.amounts_of.count
        self.vector = runtime.vector(state.dimension)
        self.real = runtime.real()
        self.fine = self.amounts_of.fine
        self.faces = FaceFields(builder, assembly.gas_faces, state, tears)
        bodies = [gas.body for gas in self.gases]
        self.face_gas = np.searchsorted(bodies, assembly.gas_faces.body).astype(np.int32)
        """Gas of every face, which rises, shape (F,)."""
        self.particle_gas = np.full(state.count, -1, dtype=np.int32)
        """Gas that presses on a particle, -1 if none, shape (particle_count,)."""
        self.particle_gas[assembly.gas_faces.faces] = self.face_gas[:, None]
        self.blocks = GroupFields(builder, GroupBlocks.of(self.face_gas, self.count))
        self.prepare_count = self.blocks.block_count
        """Blocks of faces, each summed by one call of :meth:`prepare_at`."""
        self.tearing = tears is not None
        self.flows = self.amounts_of.leaks or self.amounts_of.pumped or self.tearing
        self.booked = ledger is not None
        self.flow_term = 0 if ledger is None else ledger.index("gas_flow")
        self._place(builder)

    def _place(self, builder: ti.FieldsBuilder) -> None:
        self.gas = place(builder, ti.field(ti.i32), self.state.count)
        """:attr:`particle_gas`."""
        self.share = place(builder, self.vector.field(), self.faces.count)
        """Part of a face's outward area vector that each corner takes [m^2], shape (F,)."""
        self.block_volume = place(builder, ti.field(self.fine), self.prepare_count)
        self.reference = place(builder, ti.field(ti.i32), self.count)
        """A particle of the body: volumes are measured from it, and energies booked on it."""
        self.gauge = place(builder, ti.field(self.real), self.count)
        """p - p0 that presses [Pa], shape (G,)."""
        self.inverted = place(builder, ti.field(ti.i32), self.count)
        """1 where a body was inside out since the last look."""
        if self.tearing:
            self.hole = place(builder, ti.field(ti.i32), self.faces.count)
            """1 where a face has a torn edge."""
            self.block_hole = place(builder, ti.field(self.fine), self.prepare_count)

    def linearise(self, builder: ti.FieldsBuilder) -> None:
        """Make room for what :meth:`product_on` and :meth:`block_on` need; before the tree is finalised."""
        self.linearised = True
        self.bulk = place(builder, ti.field(self.real), self.count)
        """-dp/dV [Pa/m^3], shape (G,)."""
        self.outside = place(builder, ti.field(ti.i32), self.count)
        """1 where the last pass found a body inside out."""
        self.turn = place(builder, self.vector.field(), self.faces.count)
        """How ``share`` changes along a vector, shape (F,)."""
        self.block_change = place(builder, ti.field(self.fine), self.prepare_count)
        self.fall = place(builder, ti.field(self.real), self.count)
        """How the pressure falls along it, shape (G,)."""
        self.product_count = self.prepare_count

    def load(self, assembly: Assembly) -> None:
        """Upload faces and constants, and the amounts that the scene starts with."""
        self.faces.load()
        self.blocks.load()
        blocks = self.blocks.blocks
        reference = assembly.gas_faces.faces[blocks.first[blocks.row[:-1]], 0]
        self._write(self.particle_gas, np.ascontiguousarray(reference))
        self.amounts_of.load()

    # -- the pass before the forces -----------------------------------------------------------------

    @ti.func
    def prepare_at(self, k, slot, time, dt):
        """Area vectors, volume, and area of holes, of block k of faces."""
        origin = self._origin_of(self.blocks.group[k], slot)
        volume, open_area = ti.cast(0.0, self.fine), ti.cast(0.0, self.fine)
        for f in range(self.blocks.first[k], self.blocks.first[k + 1]):
            start, area = self._face_at(f, slot)
            self.share[f] = ti.cast(area / self.state.dimension, self.real)
            volume += (start - origin).dot(area)
            if ti.static(self.tearing):
                self.hole[f] = self.faces.is_torn(f)
                if self.hole[f] == 1:
                    open_area += area.norm()
        self.block_volume[k] = volume / self.state.dimension
        if ti.static(self.tearing):
            self.block_hole[k] = open_area

    @ti.func
    def prepare_end(self, slot, time, dt):
        """Gauge pressure of every gas; then what flows in and out over ``dt`` [s] from ``time`` [s]."""
        for g in range(self.count):
            volume, hole = ti.cast(0.0, self.fine), ti.cast(0.0, self.fine)
            for k in range(self.blocks.row[g], self.blocks.row[g + 1]):
                volume += self.block_volume[k]
                if ti.static(self.tearing):
                    hole += self.block_hole[k]
            u = self._strain_at(g, volume)
            self.gauge[g] = self.amounts_of.gauge_at(g, u)
            if ti.static(self.linearised):
                self.bulk[g] = self.amounts_of.bulk_at(g, u)
                self.outside[g] = self.amounts_of.is_inverted(u)
            # Schemes that need the linearised law also try states out, without time passing, and take them back.
            if self.amounts_of.is_inverted(u) and (ti.static(not self.linearised) or dt > 0.0):
                self.inverted[g] = 1
            if ti.static(self.flows):
                if dt > 0.0:
                    gain = self.amounts_of.flow(g, u, hole, ti.cast(time, self.fine), ti.cast(dt, self.fine))
                    if ti.static(self.booked):
                        self.ledger.add(self.flow_term, self.reference[g], gain)

    @ti.func
    def volume_at(self, g):
        """Volume of gas g by the last pass over the blocks [m^3]."""
        volume = ti.cast(0.0, self.fine)
        for k in range(self.blocks.row[g], self.blocks.row[g + 1]):
            volume += self.block_volume[k]
        return volume

    @ti.func
    def _strain_at(self, g, volume):
        rest = self.amounts_of.rest_volume[g]
        return (volume - rest) / rest

    @ti.func
    def _volume_of(self, g, slot):
        """Volume of gas g [m^3], measured anew."""
        origin = self._origin_of(g, slot)
        volume = ti.cast(0.0, self.fine)
        for f in range(self.blocks.first[self.blocks.row[g]], self.blocks.first[self.blocks.row[g + 1]]):
            start, area = self._face_at(f, slot)
            volume += (start - origin).dot(area)
        return volume / self.state.dimension

    @ti.func
    def _origin_of(self, g, slot):
        """Where the volume is measured from: a point of the body, as far from it the parts would cancel."""
        return ti.cast(self.state.x[slot, self.reference[g]], self.fine)

    @ti.func
    def _face_at(self, f, slot):
        """First corner of a face [m], and its area vector [m^2] that looks out."""
        corners = self.faces.corners[f]
        a = ti.cast(self.state.x[slot, corners[0]], self.fine)
        side = ti.cast(self.state.x[slot, corners[1]], self.fine) - a
        area = side
        if ti.static(self.state.dimension == 2):
            area[0], area[1] = side[1], -side[0]
        else:
            area = 0.5 * side.cross(ti.cast(self.state.x[slot, corners[2]], self.fine) - a)
        return a, area

    # -- force and energy ---------------------------------------------------------------------------

    @ti.func
    def force_on(self, i, slot):
        force = self.vector(0.0)
        if self.gas[i] >= 0:
            force = self.gauge[self.gas[i]] * self._area_on(i, 0)
        return force

    @ti.func
    def dissipation_on(self, i, slot):
        """What the force lacks of the energy's gradient: the share of holes [N]."""
        force = self.vector(0.0)
        if ti.static(self.tearing):
            if self.gas[i] >= 0:
                force = -self.gauge[self.gas[i]] * self._area_on(i, 1)
        return force

    # -- stiffness ----------------------------------------------------------------------------------
    #
    # With s = dV/dx: n R T / V^2 s s^T - (p - p0) ds/dx. The second part has no sign of its own; together with
    # springs under tension, which hold the gas, it is positive, and without it Newton would crawl.

    @ti.func
    def prepare_product_at(self, k, slot, u: ti.template()):
        """Change of volume and area vectors of block k of faces along u, a field of vectors."""
        change = ti.cast(0.0, self.fine)
        for f in range(self.blocks.first[k], self.blocks.first[k + 1]):
            corners = self.faces.corners[f]
            a, b = u[corners[0]], u[corners[1]]
            total, side = a + b, b - a
            turn = side
            if ti.static(self.state.dimension == 2):
                turn[0], turn[1] = side[1], -side[0]
            else:
                c = u[corners[2]]
                total += c
                x = self.state.x[slot, corners[0]]
                turn = 0.5 * side.cross(self.state.x[slot, corners[2]] - x)
                turn += 0.5 * (self.state.x[slot, corners[1]] - x).cross(c - a)
            change += self.share[f].dot(total)
            self.turn[f] = turn / self.state.dimension
        self.block_change[k] = change

    @ti.func
    def prepare_product_end(self):
        """How the pressures fall along it."""
        for g in range(self.count):
            change = ti.cast(0.0, self.fine)
            for k in range(self.blocks.row[g], self.blocks.row[g + 1]):
                change += self.block_change[k]
            self.fall[g] = self.bulk[g] * ti.cast(change, self.real)

    @ti.func
    def product_on(self, i, slot, u: ti.template(), stiff, damp):
        """Row i of ``stiff`` K u, for the u that was prepared."""
        product = self.vector(0.0)
        g = self.gas[i]
        if g >= 0:
            for h in range(self.faces.row[i], self.faces.row[i + 1]):
                f = self.faces.entry[h]
                part = self.fall[g] * self.share[f] - self.gauge[g] * self.turn[f]
                if ti.static(self.tearing):
                    part *= ti.select(self.hole[f] == 0, 1.0, 0.0)
                product += part
        return stiff * product

    @ti.func
    def block_on(self, i, slot, stiff, damp):
        """Diagonal block of ``stiff`` K, of particle i: the second part has none."""
        g = self.gas[i]
        area = self.vector(0.0)
        bulk = 0.0 * stiff
        if g >= 0:
            area = self._area_on(i, 0)
            bulk = stiff * self.bulk[g]
        return bulk * area.outer_product(area)

    @ti.func
    def is_outside(self) -> ti.i32:
        """1 where the last pass found a body inside out: there is no force that would turn it back."""
        outside = 0
        for g in range(self.count):
            outside = ti.max(outside, self.outside[g])
        return outside

    @ti.func
    def area_on(self, i):
        """What the gas presses on at particle i, by the last pass: its share of whole faces [m^2]."""
        return self._area_on(i, 0)

    @ti.func
    def _area_on(self, i, hole):
        """Particle i's share of the area vectors of its faces [m^2]: of whole ones, or with ``hole`` 1 of holes."""
        area = self.vector(0.0)
        for h in range(self.faces.row[i], self.faces.row[i + 1]):
            f = self.faces.entry[h]
            if ti.static(self.tearing):
                area += self.share[f] * ti.select(self.hole[f] == hole, 1.0, 0.0)
            else:
                area += self.share[f]
        return area

    @ti.func
    def energy_on(self, i, slot):
        """Free energy of the gas [J], 0 in the volume at rest; all of it on the body's reference particle."""
        energy = ti.cast(0.0, self.fine)
        g = self.gas[i]
        if g >= 0:
            if self.reference[g] == i:
                energy = self.amounts_of.energy_at(g, self._strain_at(g, self._volume_of(g, slot)))
        return ti.cast(energy, self.real)

    # -- what the host asks -------------------------------------------------------------------------

    def volumes(self) -> FloatArray:
        """Volume inside every body with gas [m^3], in 2D that of 1 m thickness, shape (G,)."""
        return self._survey()[0]

    def gauge_pressures(self) -> FloatArray:
        """Pressure of every gas above the one outside [Pa], 0 in a body that is inside out, shape (G,)."""
        return self._survey()[1]

    def pressures(self) -> FloatArray:
        """Absolute pressure of every gas [Pa], shape (G,)."""
        return self.gauge_pressures() + np.array([gas.ambient for gas in self.gases])

    def amounts(self) -> FloatArray:
        """Amount of every gas [mol], shape (G,)."""
        return self.amounts_of.amounts()

    def alarm(self) -> str | None:
        """What went wrong since the last look: the first body whose volume was not positive."""
        inverted = np.empty(self.count, dtype=np.int32)
        self._take_inverted(inverted)
        if not inverted.any():
            return None
        name = self.gases[int(inverted.argmax())].name
        return f"body {name!r} turned inside out: its volume is not positive"

    def keep(self) -> None:
        """Copy amounts into a backup."""
        self.amounts_of.keep()

    def restore(self) -> None:
        """Copy the backup back."""
        self.amounts_of.restore()

    def memory(self) -> dict[str, FloatArray]:
        """What :meth:`remember` takes."""
        return self.amounts_of.memory()

    def remember(self, values: dict[str, FloatArray]) -> None:
        """Set amounts from :meth:`memory`."""
        self.amounts_of.remember(values)

    def _survey(self) -> FloatArray:
        values = np.empty((2, self.count))
        self._read(self.state.slot, values)
        return values

    # -- to and from fields -------------------------------------------------------------------------

    @ti.kernel
    def _read(self, slot: int, values: ti.types.ndarray()):
        ti.loop_config(serialize=self.state.serialize)
        for g in range(self.count):
            volume = self._volume_of(g, slot)
            values[0, g] = volume
            values[1, g] = self.amounts_of.gauge_at(g, self._strain_at(g, volume))

    @ti.kernel
    def _take_inverted(self, inverted: ti.types.ndarray()):
        ti.loop_config(serialize=self.state.serialize)
        for g in range(self.count):
            inverted[g] = self.inverted[g]
            self.inverted[g] = 0

    @ti.kernel
    def _write(self, gas: ti.types.ndarray(), reference: ti.types.ndarray()):
        for i in range(gas.shape[0]):
            self.gas[i] = gas[i]
        for g in range(reference.shape[0]):
            self.reference[g] = reference[g]
