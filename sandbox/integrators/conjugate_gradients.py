"""Matrix-free conjugate gradients for A u = r with A = inertia M + stiff K + damp C, preconditioned by blocks.

Laws give products and diagonal blocks of K and C; nothing is assembled. Each particle's block is kept as
L D L^T: as A is at least inertia M, no pivot may be less than the particle's own inertia, and so rounding
never makes a block indefinite, however stiff it is one way and soft another.

Where something bears a particle (:mod:`sandbox.integrators.resting`) residuals and products are filtered: the
modified method of Baraff and Witkin, "Large steps in cloth simulation" (1998). Laws whose K is not positive in
every shape are met as truncated Newton methods meet them: the solution ends before a direction of no
curvature (Nocedal and Wright, Numerical Optimization, section 7.1).
"""

from typing import Any

import numpy as np
import taichi as ti

from sandbox import runtime
from sandbox.integrators.block_sums import BlockSums
from sandbox.state import ParticleState, place

FALL, SIZE = 0, 1
_DREGS = 1e-2
"""Part of what rounding leaves of a residual that no direction is worth looking for below [1]."""


@ti.data_oriented
class ConjugateGradients:
    """One solve at a time, of at most ``most`` iterations.

    Parameters
    ----------
    laws : those with ``product_on`` and ``block_on`` count, the others have no stiffness
    resting : what filters the vectors: one part or none
    """

    def __init__(
        self, builder: ti.FieldsBuilder, state: ParticleState, laws: list[Any], resting: list[Any], most: int
    ) -> None:
        self.state = state
        self.laws = [law for law in laws if hasattr(law, "product_on")]
        self.linking = [law for law in self.laws if hasattr(law, "place_links")]
        self.others = [law for law in self.laws if not hasattr(law, "place_links")]
        for law in self.linking:
            law.place_links(builder)
        self.preparing = [law for law in self.laws if hasattr(law, "prepare_product_at")]
        self.damped = any(law.damped for law in self.laws)
        self.resting = resting
        self.most = most
        self.rounding = float(np.finfo("float64" if runtime.settings().precision == "f64" else "float32").eps)
        self.real = runtime.real()
        self.vector = runtime.vector(state.dimension)
        self.matrix = ti.types.matrix(state.dimension, state.dimension, runtime.real())
        vectors = (place(builder, self.vector.field(), state.count) for _ in range(4))
        self.solution, self.residual, self.direction, self.image = vectors
        """u [m/s], r [N s], direction [m/s], and its image [N s] or what else the next direction is made of [m/s]."""
        self.first = place(builder, self.vector.field(), state.count)
        """r at the start [N s]."""
        self.factor = place(builder, self.matrix.field(), state.count)
        """L below the diagonal, 1 / D on it."""
        self.inertia = place(builder, ti.field(self.real), state.count)
        """Mean of A's diagonal at every particle: what it takes to move it alone [kg]."""
        self.sums = BlockSums(builder, state.count, 2)
        fine = self.sums.fine
        self.fall, self.size, self.noise, self.alpha, self.beta = (place(builder, ti.field(fine), 1) for _ in range(5))
        self.goal, self.ratio, self.enough, self.least = (place(builder, ti.field(fine), 1) for _ in range(4))
        self.count = place(builder, ti.field(ti.i32), 1)
        """Iterations of this solve."""
        self.going = place(builder, ti.field(ti.i32), 1)
        """1 while the solve is not done."""
        self.yielding = place(builder, ti.field(ti.i32), 1)
        """1 where compressed springs may give way in the next solve."""
        self.guessed = place(builder, ti.field(ti.i32), 1)
        self.bent = place(builder, ti.field(ti.i32), 1)
        """1 where this solve met a direction of no curvature, and ended there."""

    # -- the matrix ---------------------------------------------------------------------------------

    @ti.func
    def linearise(self, i, slot, guess, inertia, stiff, damp):
        """The residual of particle i as the right side, A at the state in ``slot``, and a ``guess`` of the solution.

        Returns what rounding of positions and velocities leaves of r^T M^-1 r.
        """
        w = self.state.inverse_mass[i]
        r, u = self.vector(0.0), self.vector(0.0)
        noise = 0.0 * stiff
        if w > 0.0:
            m = inertia * self.state.mass[i]
            for law in ti.static(self.linking):
                law.link(i, slot, stiff, damp, ti.cast(self.yielding[0], self.real))
            matrix, unsure = self._block_of(i, slot, stiff, damp)
            own = self.rounding * self.state.mass[i] * ti.abs(self.state.v[slot, i] + guess).max()
            noise = w * (unsure * unsure / stiff + own * own)
            for axis in ti.static(range(self.state.dimension)):
                matrix[axis, axis] += m
            self.inertia[i] = matrix.trace() / self.state.dimension
            r, u = self.residual[i], guess
            for resting in ti.static(self.resting):
                r = resting.filter(i, r)
                u = resting.filter(i, u)
                matrix = resting.confine(i, matrix, m)
            self.factor[i] = self._factored(matrix, m)
        self.first[i] = r
        self.residual[i] = r
        self.image[i] = u
        self.solution[i] = self.vector(0.0)
        return noise

    @ti.func
    def _block_of(self, i, slot, stiff, damp):
        """Block of stiff K + damp C; and what rounding of positions makes of stiff K x [kg m]."""
        matrix = self.matrix(0.0)
        unsure = 0.0 * stiff
        for part in range(ti.static(2 if self.damped else 1)):
            stiffly, damply = ti.select(part == 0, stiff, 0.0), ti.select(part == 0, 0.0, damp)
            for law in ti.static(self.laws):
                matrix += law.block_on(i, slot, stiffly, damply)
            if part == 0:
                unsure = self.rounding * ti.abs(self.state.x[slot, i]).max() * matrix.trace()
        return matrix, unsure

    @ti.func
    def _factored(self, matrix, least):
        """L D L^T of a matrix whose pivots are at least ``least``."""
        factor = self.matrix(0.0)
        for k in ti.static(range(self.state.dimension)):
            pivot = matrix[k, k]
            for j in ti.static(range(k)):
                # Below the diagonal stands L D until its row is done.
                for n in ti.static(range(j)):
                    factor[k, j] -= factor[k, n] * factor[j, n]
                factor[k, j] += matrix[k, j]
            for j in ti.static(range(k)):
                entry = factor[k, j] * factor[j, j]
                pivot -= entry * factor[k, j]
                factor[k, j] = entry
            factor[k, k] = 1.0 / ti.max(pivot, least)
        return factor

    @ti.func
    def precondition(self, i, r):
        """Solve with the block of particle i alone."""
        factor = self.factor[i]
        z = r
        for k in ti.static(range(self.state.dimension)):
            for j in ti.static(range(k)):
                z[k] -= factor[k, j] * z[j]
        for k in ti.static(range(self.state.dimension)):
            z[k] *= factor[k, k]
        for k in ti.static(range(self.state.dimension - 1, -1, -1)):
            for j in ti.static(range(k + 1, self.state.dimension)):
                z[k] -= factor[j, k] * z[j]
        for resting in ti.static(self.resting):
            z = resting.filter(i, z)
        return z

    @ti.func
    def product(self, i, slot, inertia, stiff, damp):
        """Row i of A times the direction."""
        image = inertia * self.state.mass[i] * self.direction[i]
        for law in ti.static(self.linking):
            image += law.linked_product_on(i, self.direction)
        for law in ti.static(self.others):
            image += law.product_on(i, slot, self.direction, stiff, damp)
        for resting in ti.static(self.resting):
            image = resting.filter(i, image)
        return image

    # -- the iteration ------------------------------------------------------------------------------

    @ti.func
    def start(self, guessed, noise, ratio, enough, least):
        """Begin, after :meth:`linearise` of all particles; with ``guessed`` 0 no guess was given. Within a serial loop.

        Ends when r^T M^-1 r is ``enough`` or down to a ``ratio`` of that of the guess, but at least to ``least``.
        """
        self.noise[0], self.ratio[0], self.enough[0], self.least[0] = noise, ratio, enough, least
        self.beta[0] = 0.0
        self.bent[0], self.guessed[0] = 0, guessed
        self.count[0] = -1  # the guess is taken as a first direction, to be gone in full
        self.going[0] = 1

    @ti.func
    def iterate(self, slot, inertia, stiff, damp):
        """One iteration: three passes over the particles, and what laws must know of the direction."""
        for block in range(self.sums.blocks):
            self._direct(block)
        # The image of no guess needs no product: it is zero, as the direction that led here.
        some = ti.cast(self.count[0] >= 0 or self.guessed[0] == 1, ti.i32)
        for law in ti.static(self.preparing):
            for k in range(some * law.product_count):
                law.prepare_product_at(k, slot, self.direction)
            ti.loop_config(serialize=True)
            for _ in range(1):
                law.prepare_product_end()
        for block in range(some * self.sums.blocks):
            self._apply(block, slot, inertia, stiff, damp)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self._measure()
        for block in range(self.sums.blocks):
            self._advance(block)
        ti.loop_config(serialize=True)
        for _ in range(1):
            self._conclude()

    @ti.func
    def _direct(self, block):
        beta = ti.cast(self.beta[0], self.real)
        for i in range(self.sums.first(block), self.sums.end(block)):
            self.direction[i] = self.image[i] + beta * self.direction[i]

    @ti.func
    def _apply(self, block, slot, inertia, stiff, damp):
        curvature = self.sums.zero()
        for i in range(self.sums.first(block), self.sums.end(block)):
            image = self.vector(0.0)
            if self.state.inverse_mass[i] > 0.0:
                image = self.product(i, slot, inertia, stiff, damp)
            self.image[i] = image
            curvature += self.direction[i].dot(image)
        self.sums.put(block, FALL, curvature)

    @ti.func
    def _measure(self):
        """How far to go along the direction."""
        curvature = self.sums.total(FALL)
        self.alpha[0] = 0.0
        if self.count[0] < 0:
            self.alpha[0] = 1.0
        elif curvature > 0.0:
            self.alpha[0] = self.fall[0] / curvature
        else:
            self.going[0] = 0
            self.bent[0] = 1
            if self.count[0] == 0:
                self.alpha[0] = 1.0  # downhill in any case

    @ti.func
    def _advance(self, block):
        alpha = ti.cast(self.alpha[0], self.real)
        fall, size = self.sums.zero(), self.sums.zero()
        for i in range(self.sums.first(block), self.sums.end(block)):
            self.solution[i] = self.solution[i] + alpha * self.direction[i]
            r = self.residual[i] - alpha * self.image[i]
            z = self.vector(0.0)
            if self.state.inverse_mass[i] > 0.0:
                for resting in ti.static(self.resting):
                    r = resting.filter(i, r)
                z = self.precondition(i, r)
            self.residual[i] = r
            self.image[i] = z
            fall += r.dot(z)
            size += self.state.inverse_mass[i] * r.dot(r)
        self.sums.put(block, FALL, fall)
        self.sums.put(block, SIZE, size)

    @ti.func
    def _conclude(self):
        """Whether that was enough."""
        fall = self.sums.total(FALL)
        self.size[0] = self.sums.total(SIZE)
        self.count[0] += 1
        self.beta[0] = 0.0
        if self.count[0] == 0:
            self.goal[0] = ti.max(self.ratio[0] * self.size[0], self.enough[0])
            self.goal[0] = ti.min(self.goal[0], self.least[0] * self.size[0])
            # Of a guess that is right to rounding nothing is left but that: directions made of it may lead anywhere.
            self.goal[0] = ti.max(self.goal[0], _DREGS * self.noise[0])
        else:
            self.beta[0] = fall / self.fall[0]
        self.fall[0] = fall
        if self.size[0] <= self.goal[0] or self.count[0] >= self.most or fall <= 0.0:
            self.going[0] = 0
