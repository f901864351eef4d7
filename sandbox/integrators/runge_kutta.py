"""Explicit Runge-Kutta schemes from their tableaux: one pass over all particles a stage.

With s stages, x_i = x + h sum_j a_ij v_j and v_i likewise from accelerations. All stages share one kernel:
the tableau, times the step, is a small field. Colliders are met in every stage, without restitution before the
last: a particle that is pressed on a surface would have a velocity into it there, which dampers take for real.

Drag is taken out of the equations: for u = exp(gamma t) v they have none (Lawson 1967), so no step is too
long for it. The last row is scaled so that a constant force is met exactly too, which is a correction of the
scheme's own order.
"""

import math
from dataclasses import replace

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.integrators.kick import PlainKick
from sandbox.integrators.schemes import RungeKuttaScheme
from sandbox.integrators.step_end import StepEnd
from sandbox.integrators.stepper import Setup, Stepper
from sandbox.state import FIRST_STAGE_SLOT, SLICE, place


@ti.data_oriented
class RungeKutta(Stepper):
    """Advances a state by an explicit Runge-Kutta scheme."""

    def __init__(self, setup: Setup, scheme: RungeKuttaScheme) -> None:
        super().__init__(setup, PlainKick())
        builder, real = setup.builder, runtime.real()
        self.scheme = scheme
        self.stages = scheme.stages
        self.end = StepEnd(setup.state, setup.parts, setup.pinned)
        bearing = [collider.under_solver() for collider in setup.parts.colliders] if self.stages > 1 else []
        self.stage_end = StepEnd(
            setup.state, replace(setup.parts, colliders=bearing, carriers=[], contact=[]), setup.pinned
        )
        self.acceleration = place(builder, self.vector.field(), self.stages, self.state.count)
        """Of every stage [m/s^2]."""
        self.drift = place(builder, ti.field(real), self.stages, self.stages)
        """Row r: what the velocities of stages 0 to r give to the place after stage r [s]."""
        self.kick = place(builder, ti.field(real), self.stages, self.stages)
        """The same of accelerations and the velocity [s]."""
        self.decay = place(builder, ti.field(real), self.stages)
        """What is left of the velocity by then [1]."""
        self.moment = place(builder, ti.field(real), self.stages)
        """Time of every stage in the step [s]."""
        self.weight = place(builder, ti.field(real), self.stages)
        """Part of the step that each stage stands for [s]."""
        self._prepared_dt = math.nan

    def advance(self, steps: int, dt: float, time: float) -> None:
        """Take ``steps`` steps of ``dt`` [s] from ``time`` [s]."""
        if dt != self._prepared_dt:
            self._write(*step_tableau(self.scheme, dt, self.drag))
            self._prepared_dt = dt
        super().advance(steps, dt, time)

    def take_step(self, step: int, steps: int, slot: int, dt: float, time: float) -> None:
        """One step, a launch a stage."""
        for stage in range(self.stages):
            self._stage(stage, slot, step, dt, time)

    @ti.kernel
    def _stage(self, stage: int, slot: int, step: int, dt: float, time: float):
        self.prepare(stage, slot, dt, time + step * dt)
        self.take_stage(stage, slot, dt)

    @ti.kernel
    def run_serial(self, slot: int, steps: int, dt: float, time: float):
        ti.loop_config(serialize=True)
        for n in range(steps * self.stages):
            stage, step = n % self.stages, n // self.stages
            begun = self.slot_at(slot, step)
            self.prepare(stage, begun, dt, time + step * dt)
            self.take_stage(stage, begun, dt)
            if ti.static(self.contact):
                if stage == self.stages - 1:
                    self.meet_others_serial(begun, dt)

    @ti.func
    def prepare(self, stage, slot, dt, time):
        """What laws must know of the stage's state; what moves and flows does so once a step."""
        if ti.static(self.stages == 1):
            self.preparation.begin(slot, time, dt)
        elif ti.static(len(self.preparation.all) > 0):
            # The loops of a branch run in turn. Volumes and winds are few against particles.
            if stage == 0:
                self.preparation.begin(slot, time, dt)
            else:
                self.preparation.again(self.slot_of(stage, slot), time + self.moment[stage])

    @ti.func
    def slot_of(self, stage, slot):
        """Where a stage's state is."""
        return ti.select(stage == 0, slot, FIRST_STAGE_SLOT - 1 + stage)

    @ti.func
    def take_stage(self, stage, slot, dt):
        """Forces at a stage, and the state of the next one; after the last, that of the step's end."""
        if ti.static(self.slicing):
            for index in range(self.slices):
                for law in ti.static(self.slicing):
                    law.gather_slice(index, self.slot_of(stage, slot))
                for i in range(index * SLICE, ti.min((index + 1) * SLICE, self.state.count)):
                    self.take(i, stage, slot, dt)
        else:
            for i in range(self.state.count):
                self.take(i, stage, slot, dt)

    @ti.func
    def take(self, i, stage, slot, dt):
        """Particle i through a stage."""
        at = self.slot_of(stage, slot)
        if ti.static(self.evolving):
            if stage == 0:
                for law in ti.static(self.evolving):
                    law.evolve(i, slot, dt)
        force = self.vector(0.0)
        for law in ti.static(self.laws):
            force += law.force_on(i, at)
        self.acceleration[stage, i] = self.state.inverse_mass[i] * force
        start = self.state.x[slot, i]
        x, v = start, self.decay[stage] * self.state.v[slot, i]
        for j in range(stage + 1):
            x += self.drift[stage, j] * self.state.v[self.slot_of(j, slot), i]
            v += self.kick[stage, j] * self.acceleration[j, i]
        lossy = self.vector(0.0)
        for books in ti.static(self.books):
            lossy = self.book_stage(books, i, at, self.weight[stage], force)
            if stage == 0:
                books.settle(i, force - lossy)
        to = at + 1
        if stage == 0:
            to = FIRST_STAGE_SLOT
        if stage == self.stages - 1:
            to = 1 - slot
            free_x, free_v = x, v
            x, v = self.end.meet_pressed(i, start, x, v, v - self.decay[stage] * self.state.v[slot, i], dt)
            for books in ti.static(self.books):
                books.land(i, self.state.v[slot, i], force - lossy, x - free_x, free_v, v)
        elif ti.static(self.stage_end.colliders):
            x, v = self.stage_end.meet_pressed(i, start, x, v, 0.0 * v, self.moment[stage + 1])
        self.state.x[to, i] = x
        self.state.v[to, i] = v

    @ti.func
    def book_stage(self, books: ti.template(), i, at, weight, force):
        """Book what a stage stands for; the part of the force that loses energy is returned [N]."""
        lossy = books.stage(i, at, weight, force)
        if ti.static(self.drag > 0.0):
            v = self.state.v[at, i]
            books.ledger.add(books.drag_term, i, -weight * self.drag * self.state.mass[i] * v.dot(v))
        return lossy

    @ti.kernel
    def _write(
        self,
        drift: ti.types.ndarray(),
        kick: ti.types.ndarray(),
        decay: ti.types.ndarray(),
        moment: ti.types.ndarray(),
        weight: ti.types.ndarray(),
    ):
        ti.loop_config(serialize=True)
        for stage in range(self.stages):
            self.decay[stage] = decay[stage]
            self.moment[stage] = moment[stage]
            self.weight[stage] = weight[stage]
            for j in range(self.stages):
                self.drift[stage, j] = drift[stage, j]
                self.kick[stage, j] = kick[stage, j]


def step_tableau(scheme: RungeKuttaScheme, dt: float, drag: float) -> tuple[NDArray[np.float64], ...]:
    """Numbers of a step of ``dt`` [s] with a drag rate [1/s]: drift, kick [s], decay [1], moment, weight [s].

    Row r of drift and kick, shape (s, s), leads from the state at the step's start to stage r + 1, and the last
    to its end.
    """
    stages = scheme.stages
    nodes = np.array([*scheme.nodes, 1.0])
    rows = np.zeros((stages, stages))
    for stage in range(1, stages):
        rows[stage - 1, :stage] = scheme.coupling[stage]
    rows[-1] = scheme.weights
    faded = np.exp(-drag * dt * np.tril(nodes[1:, None] - nodes[None, :-1]))
    kick = rows * faded
    if drag > 0.0:
        # Over the one that fades least: of a great drag nothing else would be left of any.
        exponents = -drag * dt * (1.0 - nodes[:-1])
        least = exponents[rows[-1] != 0.0].max()
        kick[-1] = rows[-1] * np.exp(np.minimum(exponents - least, 0.0))
        kick[-1] *= -math.expm1(-drag * dt) / (drag * dt) / kick[-1].sum()
    return dt * rows, dt * kick, np.exp(-drag * dt * nodes[1:]), dt * nodes[:-1], dt * np.array(scheme.weights)
