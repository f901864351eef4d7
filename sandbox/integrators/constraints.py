"""Springs and gas as constraints with multipliers, solved one after the other on the velocities of a step.

A constraint's multiplier is the impulse that it has given so far in the step [N s, of a gas Pa s]. Each is solved
as implicit Euler has it at the end of the step, where the particles are at x0 + h v. For a spring of stiffness k
and damping c, with stretch C along the unit vector n, relative velocity u and W the sum of both inverse masses,
the impulse T that pulls changes by

    dT = (h k C + h c n.u - T) / (1 + (h^2 k + h c) W).

With the compliance a = 1/k and the multiplier lambda = -h T this is equation 26 of Macklin, Mueller and Chentanez,
"XPBD: position-based simulation of compliant constrained dynamics", MIG 2016: dividing both sides by h^2 k gives its
a / h^2, and its gamma is c / (h k). Written with k, springs without stiffness are no exception; and velocities keep
the digits that differences of positions lose when steps are short. With drag, forces act for the ``gain`` g < h of an
exact kick (:mod:`sandbox.integrators.kick`), as all others do, or weights would hang lower in longer steps:

    dT = (g k C + g c n.u - T) / (1 + (g h k + g c) W).

As published, what a constraint gives in an iteration keeps the direction that it had then, and the iterations end at
impulses that are along none of the final directions: a residual of 1e-5 to 1e-3, and force errors of 0.5 % on a
swinging chain. Here multipliers are vectors that turn with their constraint, and the end is implicit Euler itself.
"""

import itertools
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.group_blocks import GroupBlocks, GroupFields
from sandbox.integrators.colouring import ColourLists, colour_edges
from sandbox.scene.assemble import Assembly
from sandbox.state import ParticleState, place

IntArray = NDArray[np.int32]

# Smallest squared length [m^2] that is told from 0; its reciprocal square root is finite in f32.
_TINY = 1e-24
# Part of a spring's length by which its push may move its ends and still turn with it at once; from 0.4 on, bodies
# under loads that the iterations cannot solve crumple.
_TURN = 0.05


@ti.data_oriented
class SpringConstraints:
    """The S springs of a law, colour after colour: those of a colour share no particle.

    Rest lengths, stiffness and damping are the law's own, read at one of every spring's half-edges.

    Parameters
    ----------
    law : springs, with ``rows``, ``rest_length``, ``stiffness`` and, if ``damped``, ``damping`` by half-edge
    """

    def __init__(self, builder: ti.FieldsBuilder, law: Any, state: ParticleState) -> None:
        self.law = law
        self.state = state
        self.vector = runtime.vector(state.dimension)
        self.count = len(law.springs)
        colour_count, colour = colour_edges(state.count, law.springs.ends)
        lists = ColourLists.of(colour_count, colour)
        self.first = lists.first.tolist()
        """Where each colour begins among the springs here, and one after the last."""
        self.order = _by_place(law.springs.ends, colour)
        self.ends = place(builder, ti.Vector.field(2, ti.i32), self.count)
        self.half_edge = place(builder, ti.field(ti.i32), self.count)
        self.impulse = place(builder, runtime.vector(state.dimension).field(), self.count)
        """What every spring has pulled with so far in the step [N s], shape (S,)."""

    def load(self, assembly: Assembly) -> None:
        """Upload who is joined, and where each spring's numbers are."""
        _, half_edge = np.unique(self.law.rows.spring, return_index=True)
        ends = np.ascontiguousarray(self.law.springs.ends[self.order], dtype=np.int32)
        self._write(ends, half_edge[self.order].astype(np.int32))

    @ti.kernel
    def _write(self, ends: ti.types.ndarray(), half_edge: ti.types.ndarray()):
        for s in range(self.count):
            self.ends[s][0] = ends[s, 0]
            self.ends[s][1] = ends[s, 1]
            self.half_edge[s] = half_edge[s]

    def sweep(self, start: int, trial: int, dt: float, gain: float, iteration: int) -> None:
        """Solve all springs, one launch a colour."""
        for first, end in itertools.pairwise(self.first):
            self._sweep_colour(first, end, start, trial, dt, gain, iteration)

    @ti.kernel
    def _sweep_colour(self, first: int, end: int, start: int, trial: int, dt: float, gain: float, iteration: int):
        for s in range(first, end):
            self.solve(s, start, trial, dt, gain, iteration)

    @ti.func
    def sweep_serial(self, start, trial, dt, gain, iteration):
        """The same as :meth:`sweep`, for inside a serial loop of a kernel."""
        for s in range(self.count):
            self.solve(s, start, trial, dt, gain, iteration)

    @ti.func
    def solve(self, s, start, trial, dt, gain, iteration):
        """Solve spring s: from the places of slot ``start``, on the velocities of slot ``trial``."""
        a, b, h = self.ends[s][0], self.ends[s][1], self.half_edge[s]
        w_a, w_b = self.state.inverse_mass[a], self.state.inverse_mass[b]
        v_a, v_b = self.state.v[trial, a], self.state.v[trial, b]
        w = w_a + w_b
        # What the spring has given so far is taken back, and given anew along the direction that it then has.
        before = self.impulse[s]
        if iteration == 0:
            before = self.vector(0.0)
        u = v_b - v_a + w * before
        d = self.state.x[start, b] - self.state.x[start, a] + dt * u
        r2 = d.dot(d)
        normal = ti.rsqrt(ti.max(r2, _TINY)) * d
        kept = self.vector(0.0)
        own = dt * w * before
        if own.dot(own) > ti.max(own.dot(d), (_TURN * _TURN) * r2):
            # A push by more than a small part of the length, if it turned at once, would drive the spring out
            # sideways, ever further: it turns a little in every iteration.
            d -= own
            normal = ti.rsqrt(ti.max(d.dot(d), _TINY)) * d
            along = before.dot(normal)
            turned = _TURN * ti.sqrt(d.dot(d) / own.dot(own))
            kept = (1.0 - ti.min(turned, 1.0)) * (before - along * normal)
            u -= w * kept
            d += own - dt * w * kept
        stretch = d.dot(normal) - self.law.rest_length[h]
        rigidity = gain * self.law.stiffness[h]
        wanted = rigidity * stretch
        yielding = 1.0 + dt * rigidity * w
        if ti.static(self.law.damped):
            damping = gain * self.law.damping[h]
            wanted += damping * u.dot(normal)
            yielding += damping * w
        tension = wanted / yielding
        if ti.static(self.law.tension_only):
            # A rope never pushes; and its damping does not pull it shorter than it is slack.
            tension = ti.max(0.0, ti.min(tension, stretch / ti.max(dt * w, _TINY)))
        given = tension * normal + kept
        pull = given - before
        self.impulse[s] = given
        self.state.v[trial, a] = v_a + w_a * pull
        self.state.v[trial, b] = v_b - w_b * pull


@ti.data_oriented
class GasConstraints:
    """The gas of G bodies: every volume is a constraint on all M particles around it.

    The impulse of a gas is q = h (p(V) - p0) [Pa s] at the end of the step; particle i gets q times its share
    A_i = dV/dx_i of the area. With V taken to grow by h S dq, S the sum of w_i |A_i|^2, what p V = n R T asks for
    is the positive root of a quadratic, so that no step can turn a body inside out along its own gradient.

    Parameters
    ----------
    law : the pressure, which measures volumes
    """

    def __init__(self, builder: ti.FieldsBuilder, law: Any, state: ParticleState) -> None:
        self.law = law
        self.state = state
        self.gas_count = law.count
        self.fine, self.real = law.fine, runtime.real()
        self.blocks = GroupFields(builder, GroupBlocks.of(law.particle_gas, law.count))
        """Blocks of particles of one gas, summed one after the other."""
        self.count = self.blocks.member_count
        self.area = place(builder, runtime.vector(state.dimension).field(), self.count)
        """A_i [m^2], shape (M,)."""
        self.block_sum = place(builder, ti.field(self.fine), self.blocks.block_count)
        self.impulse = place(builder, ti.field(self.fine), self.gas_count)
        """What every gas has pressed with so far in the step [Pa s], shape (G,)."""
        self.change = place(builder, ti.field(self.real), self.gas_count)
        """Of the impulse, in this iteration [Pa s], shape (G,)."""
        self.turn = place(builder, ti.field(self.real), self.gas_count)
        """Part of the way that shares turn after the faces in this iteration [1], shape (G,)."""
        self.slope = place(builder, ti.field(self.fine), self.gas_count)
        """Most that a velocity turns with a share, by impulse and way [m^(d-1)/kg], shape (G,)."""
        self.given = place(builder, runtime.vector(state.dimension).field(), self.count)
        """Share of every particle in the impulse of its gas so far [N s], shape (M,)."""

    def load(self, assembly: Assembly) -> None:
        """Upload who belongs to which gas."""
        self.blocks.load()
        self._write(_slopes(self.law, assembly))

    @ti.kernel
    def _write(self, slopes: ti.types.ndarray()):
        for g in range(self.gas_count):
            self.slope[g] = slopes[g]

    @ti.kernel
    def sweep(self, start: int, trial: int, dt: float, gain: float, iteration: int):
        """Solve all gases in one launch."""
        self.sweep_serial(start, trial, dt, gain, iteration)

    @ti.func
    def sweep_serial(self, start, trial, dt, gain, iteration):
        """The same as :meth:`sweep`; its loops are serial where the calling kernel calls it inside another one."""
        for m in range(self.count):
            i = self.blocks.member[m]
            self.state.x[trial, i] = self.state.x[start, i] + dt * self.state.v[trial, i]
        for k in range(self.law.prepare_count):
            self.law.prepare_at(k, trial, 0.0, 0.0)
        for k in range(self.blocks.block_count):
            self._sum_block(k)
        ti.loop_config(serialize=True)
        for g in range(self.gas_count):
            self._solve(g, dt, gain, iteration)
        for m in range(self.count):
            i = self.blocks.member[m]
            self._give(m, self.law.gas[i], i, trial, iteration)

    @ti.func
    def _give(self, m, g, i, trial, iteration):
        """Give member m, particle i, its share of the change; what it has turns after its faces."""
        before = self.given[m]
        if iteration == 0:
            before = 0.0 * before
        whole = ti.cast(self.impulse[g], self.real) * self.area[m]
        share = before + self.change[g] * self.area[m]
        share += self.turn[g] * (whole - share)
        self.given[m] = share
        self.state.v[trial, i] = self.state.v[trial, i] + self.state.inverse_mass[i] * (share - before)

    @ti.func
    def refresh(self, trial):
        """Have the law know volumes and pressures at the places of slot ``trial``."""
        for k in range(self.law.prepare_count):
            self.law.prepare_at(k, trial, 0.0, 0.0)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.law.prepare_end(trial, 0.0, 0.0)

    @ti.func
    def _sum_block(self, k):
        total = ti.cast(0.0, self.fine)
        for m in range(self.blocks.first[k], self.blocks.first[k + 1]):
            i = self.blocks.member[m]
            area = self.law.area_on(i)
            self.area[m] = area
            total += ti.cast(self.state.inverse_mass[i] * area.dot(area), self.fine)
        self.block_sum[k] = total

    @ti.func
    def _solve(self, g, dt, gain, iteration):
        """Change of the impulse of gas g."""
        h, time = ti.cast(dt, self.fine), ti.cast(gain, self.fine)
        total = ti.cast(0.0, self.fine)
        for k in range(self.blocks.row[g], self.blocks.row[g + 1]):
            total += self.block_sum[k]
        amounts = self.law.amounts_of
        volume, ambient, rest = self.law.volume_at(g), amounts.ambient[g], amounts.rest_volume[g]
        before = ti.select(iteration == 0, 0.0 * volume, self.impulse[g])
        # (p - p0) V, without a difference of nearly equal numbers.
        gauge_volume = amounts.excess[0, g] * rest - ambient * (volume - rest)
        # dV^2 + b dV = h S (g (p - p0) V - q V), for dV = h S dq.
        b = volume + h * total * (time * ambient + before)
        missing = time * gauge_volume - before * volume
        root = ti.sqrt(ti.max(b * b + 4.0 * h * total * missing, 0.0))
        change = 0.0 * volume
        if b > 0.0:
            change = 2.0 * missing / (b + root)
        elif total > 0.0:
            change = (root - b) / (2.0 * h * total)
        self.impulse[g] = before + change
        self.change[g] = ti.cast(change, self.real)
        self.turn[g] = ti.cast(1.0 / (1.0 + h * ti.abs(before + change) * self.slope[g]), self.real)


def constraints_of(builder: ti.FieldsBuilder, law: Any, state: ParticleState) -> Any:
    """The constraints that stand for a law; None where it can only act as a force."""
    kinds = {"springs": SpringConstraints, "gas": GasConstraints}
    kind = kinds.get(getattr(law, "constraint", ""))
    return None if kind is None else kind(builder, law, state)


def _by_place(ends: IntArray, colour: IntArray) -> NDArray[np.int64]:
    """Order of springs by colour, then by their first particle: neighbours in space are so in memory."""
    low, high = ends.min(axis=1), ends.max(axis=1)
    return np.lexsort((high, low, colour))


def _slopes(law: Any, assembly: Assembly) -> NDArray[np.float64]:
    """Most that a particle's share of area changes, by its way and that of its neighbours, over its mass, by gas.

    In 2D a share is half the way between both neighbours; in 3D it grows with the edges around a particle.
    """
    faces = law.faces.faces.faces
    edges = np.ones(len(faces))
    if assembly.dimension == 3:
        corners = assembly.positions[faces]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).sum(axis=1) / 3.0
    around = sum(np.bincount(faces[:, k], 0.5 * edges, assembly.particle_count) for k in range(faces.shape[1]))
    rate = around * assembly.inverse_masses
    return np.array([rate[faces[law.face_gas == g]].max(initial=0.0) for g in range(law.count)])
