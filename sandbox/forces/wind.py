"""Moving air: pressure drag and skin friction on the faces of thin bodies.

Every face feels 1/2 rho A |u| (C_D (u n) n + C_S u_t), with u the wind at its centre less its own
velocity, n its normal and u_t the part of u along it: the flat plate of any book on aerodynamics.
It acts on both sides alike, and in equal parts on the corners. In 2D faces are edges, 1 m deep.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from sandbox import runtime
from sandbox.forces.face_fields import FaceFields
from sandbox.forces.tears import Tears
from sandbox.ledger import Ledger
from sandbox.scene.assemble import Assembly
from sandbox.scene.model import Breeze, Gust, Vortex, Wind
from sandbox.state import ParticleState, place

FloatArray = NDArray[np.float64]

_WAVES = 12
# Wave numbers and frequencies lie within this factor of the typical ones: far enough apart not to repeat.
_SPREAD = 1.8
# Odd polynomial for sin(2 pi r), |r| <= 1/4, by least squares; off by at most 4e-14. The library's sine
# is called number by number, this is compiled into vector instructions.
_SINE = (
    6.283185307177229, -41.341702238987565, 81.60524903180603, -76.70584111621991,
    42.05796351746339, -15.079290382184531, 3.6550618571116242,
)  # fmt: skip
# Smallest area [m^2] that has a normal.
_TINY = 1e-20


@dataclass(frozen=True)
class Waves:
    """Gusts as M plane waves of velocity: the sum of amplitude sin(2 pi (vector x + rate t + phase))."""

    vector: FloatArray
    """Wave vectors [1/m], shape (M, d)."""
    rate: FloatArray
    """[1/s], shape (M,)."""
    phase: FloatArray
    """[1], shape (M,)."""
    amplitude: FloatArray
    """Each across its wave vector, so that no air piles up [m/s], shape (M, d)."""


def gust_waves(gust: Gust, dimension: int, drift: FloatArray) -> Waves:
    """Waves of a gust in wind of mean velocity ``drift`` [m/s], shape (d,): the same for the same seed.

    They come in sets of d with wave vectors and amplitudes along the axes of a turned frame, which
    makes the mean square the same along every axis. Beside their own rate they are carried along by
    the wind (Taylor 1938: frozen turbulence).
    """
    random = np.random.default_rng(gust.seed)
    sets = _WAVES // dimension
    frames = [np.linalg.qr(random.standard_normal((dimension, dimension)))[0] for _ in range(sets)]
    scale, speed = (_SPREAD ** random.uniform(-1.0, 1.0, sets * dimension) for _ in range(2))
    vector = np.concatenate(frames) * (scale / gust.length)[:, None]
    rate = speed / gust.period * random.choice([-1.0, 1.0], sets * dimension) - vector @ drift
    amplitude = np.concatenate([np.roll(frame, 1, axis=0) for frame in frames]) * gust.strength * np.sqrt(2.0 / sets)
    return Waves(vector=vector, rate=rate, phase=random.uniform(0.0, 1.0, sets * dimension), amplitude=amplitude)


@ti.data_oriented
class WindForce:
    """The scene's wind on F faces. What the wind lacks (gusts, vortices, switching) is not compiled."""

    dissipation_term = "wind"
    damped = True
    linearised = False
    """True with what products need, see :meth:`linearise`."""

    def __init__(
        self,
        builder: ti.FieldsBuilder,
        assembly: Assembly,
        state: ParticleState,
        tears: Tears | None,
        ledger: Ledger | None,
    ) -> None:
        wind = assembly.scene.wind
        assert isinstance(wind, Wind)
        dimension = state.dimension
        self.state = state
        self.tearing = tears is not None
        self.vector = runtime.vector(dimension)
        self.matrix = ti.types.matrix(dimension, dimension, runtime.real())
        self.uniform = np.zeros(dimension) if wind.velocity is None else np.array(wind.velocity)
        self.mean = self.vector(self.uniform.tolist())
        self.pressure_drag = 0.5 * wind.density * wind.drag_coefficient
        self.skin_drag = 0.5 * wind.density * wind.skin_coefficient
        self.has_skin = wind.skin_coefficient > 0.0
        self.start, self.rise = wind.start, wind.rise
        self.end = 0.0 if wind.end is None else wind.end
        self.begins = wind.start > 0.0 or wind.rise > 0.0
        self.ends = wind.end is not None
        self.breezes = [action for action in assembly.scene.actions if isinstance(action, Breeze)]
        self.breeze_velocity = [self.vector(list(breeze.velocity)) for breeze in self.breezes]
        self.waves = None if wind.gust is None else gust_waves(wind.gust, dimension, self.uniform)
        self.gusty = self.waves is not None
        self.vortices = wind.vortices
        self.vortex_count = len(wind.vortices)
        self.turning = self.vortex_count > 0
        self.faces = FaceFields(builder, assembly.wind_faces, state, tears)
        self.prepare_count = self.faces.count
        """Faces, each handled by one call of :meth:`prepare_at`."""
        self._place(builder)

    def _place(self, builder: ti.FieldsBuilder) -> None:
        real, dimension = runtime.real(), self.state.dimension
        self.face_force = place(builder, self.vector.field(), self.prepare_count)
        """What every corner of a face feels [N], shape (F,)."""
        if self.gusty:
            # Wave vector, rate, phase and amplitude by row: consecutive waves are consecutive in memory.
            self.wave = place(builder, ti.field(real), 2 * dimension + 2, len(self.waves.rate))
        if self.turning:
            self.centre = place(builder, self.vector.field(), self.vortex_count)
            self.core = place(builder, ti.field(real), self.vortex_count)
            """Radius of the core, squared [m^2]."""
            self.spin = place(builder, ti.types.vector(3, real).field(), self.vortex_count)
            """Angular velocity of the core [rad/s]; in 2D only the last part counts."""

    def linearise(self, builder: ti.FieldsBuilder) -> None:
        """Make room for what :meth:`product_on` and :meth:`block_on` need; before the tree is finalised."""
        self.linearised = True
        self.face_normal = place(builder, self.vector.field(), self.prepare_count)
        self.face_drag = place(builder, ti.types.vector(2, runtime.real()).field(), self.prepare_count)
        """How the force falls with a face's velocity: across the normal, and what is more along it [N s/m]."""

    def load(self, assembly: Assembly) -> None:
        """Upload faces, waves and vortices."""
        self.faces.load()
        if self.waves is not None:
            waves = self.waves
            table = np.concatenate([waves.vector.T, waves.rate[None], waves.phase[None], waves.amplitude.T])
            self._write_waves(np.ascontiguousarray(table))
        if self.turning:
            centre = np.array([vortex.center for vortex in self.vortices])
            core = np.array([vortex.radius**2 for vortex in self.vortices])
            self._write_vortices(
                centre, core, np.array([_spin(vortex, self.state.dimension) for vortex in self.vortices])
            )

    # -- the air ------------------------------------------------------------------------------------

    @ti.func
    def velocity_at(self, x, time):
        """Velocity of the air at a place [m] and a time [s]."""
        velocity = self.mean
        if ti.static(self.gusty):
            velocity += self._gust_at(x, time)
        if ti.static(self.turning):
            velocity += self._vortices_at(x)
        if ti.static(self.begins or self.ends):
            velocity *= self._strength_at(time)
        for breeze in ti.static(range(len(self.breezes))):
            velocity += self._breeze_at(breeze, time)
        return velocity

    @ti.func
    def _breeze_at(self, breeze: ti.template(), time):
        """What one of the actions adds to the wind."""
        start, end = ti.static(self.breezes[breeze].start, self.breezes[breeze].end)
        strength = ti.select(time >= start and time < end, 1.0, 0.0)
        rise = ti.static(self.breezes[breeze].rise)
        if ti.static(rise > 0.0):
            strength = self._smooth((time - start) / rise) * self._smooth((end - time) / rise)
        return strength * self.breeze_velocity[breeze]

    @ti.func
    def _strength_at(self, time):
        """0 before the start and after the end, 1 in between; smooth where it rises and falls."""
        strength = 1.0
        if ti.static(self.rise > 0.0):
            strength = self._smooth((time - self.start) / self.rise)
            if ti.static(self.ends):
                strength *= self._smooth((self.end - time) / self.rise)
        else:
            strength = ti.select(time >= self.start, 1.0, 0.0)
            if ti.static(self.ends):
                strength = ti.select(time < self.end, strength, 0.0)
        return strength

    @ti.func
    def _smooth(self, s):
        s = ti.min(ti.max(s, 0.0), 1.0)
        return s * s * (3.0 - 2.0 * s)

    @ti.func
    def _gust_at(self, x, time):
        velocity = self.vector(0.0)
        dimension = ti.static(self.state.dimension)
        for m in range(self.wave.shape[1]):
            turns = self.wave[dimension, m] * time + self.wave[dimension + 1, m]
            for axis in ti.static(range(dimension)):
                turns += self.wave[axis, m] * x[axis]
            height = self._sine(turns)
            for axis in ti.static(range(dimension)):
                velocity[axis] += height * self.wave[dimension + 2 + axis, m]
        return velocity

    @ti.func
    def _sine(self, turns):
        """sin(2 pi turns)."""
        r = turns - ti.floor(turns + 0.5)
        r = ti.min(ti.max(r, -0.5 - r), 0.5 - r)
        square = r * r
        sine = _SINE[-1]
        for c in ti.static(_SINE[-2::-1]):
            sine = sine * square + c
        return r * sine

    @ti.func
    def _vortices_at(self, x):
        """Rankine's vortices: a core that turns as one, around it speed as 1 / distance."""
        velocity = self.vector(0.0)
        for k in range(self.vortex_count):
            d = x - self.centre[k]
            if ti.static(self.state.dimension == 2):
                turn = self.spin[k][2] * self.core[k] / ti.max(d.dot(d), self.core[k])
                velocity += turn * ti.Vector([-d[1], d[0]])
            else:
                around = self.spin[k].cross(d)
                # |around| is the angular velocity times the distance from the axis.
                square = around.dot(around) / ti.max(self.spin[k].dot(self.spin[k]), _TINY)
                velocity += around * (self.core[k] / ti.max(square, self.core[k]))
        return velocity

    # -- the force ----------------------------------------------------------------------------------

    @ti.func
    def prepare_at(self, k, slot, time, dt):
        """Force of the air on face k."""
        force = self._force_on_face(k, slot, time)
        if ti.static(self.tearing):
            if self.faces.is_torn(k) == 1:
                force = self.vector(0.0)
                if ti.static(self.linearised):
                    self.face_drag[k] *= 0.0
        self.face_force[k] = force / self.state.dimension

    @ti.func
    def prepare_end(self, slot, time, dt):
        pass

    @ti.func
    def _force_on_face(self, k, slot, time):
        corners = self.faces.corners[k]
        a = self.state.x[slot, corners[0]]
        b = self.state.x[slot, corners[1]]
        centre = a + b
        own = self.state.force_velocity[slot, corners[0]] + self.state.force_velocity[slot, corners[1]]
        area = self.vector(0.0)
        if ti.static(self.state.dimension == 2):
            area = ti.Vector([b[1] - a[1], a[0] - b[0]])
        else:
            c = self.state.x[slot, corners[2]]
            centre += c
            own += self.state.force_velocity[slot, corners[2]]
            area = 0.5 * (b - a).cross(c - a)
        u = self.velocity_at(centre / self.state.dimension, time) - own / self.state.dimension
        size = area.norm()
        across = u.dot(area) / ti.max(size, _TINY)
        force = (self.pressure_drag - self.skin_drag) * across * area
        if ti.static(self.has_skin):
            force += self.skin_drag * size * u
        if ti.static(self.linearised):
            self._note_drag(k, u, area / ti.max(size, _TINY), size)
        return u.norm() * force

    @ti.func
    def _note_drag(self, k, u, normal, size):
        """What stands for -dF/dv of face k: exact along the normal and across it, symmetric and positive between."""
        speed = u.norm()
        slope = u.dot(normal) / ti.max(speed, _TINY)
        skin = self.skin_drag * size * speed
        along = self.pressure_drag * size * speed * (1.0 + slope * slope)
        self.face_normal[k] = normal
        self.face_drag[k] = ti.Vector([skin, along - skin])

    @ti.func
    def force_on(self, i, slot):
        force = self.vector(0.0)
        for h in range(self.faces.row[i], self.faces.row[i + 1]):
            force += self.face_force[self.faces.entry[h]]
        return force

    @ti.func
    def dissipation_on(self, i, slot):
        """All of the force: it has no energy [N]."""
        return self.force_on(i, slot)

    @ti.func
    def product_on(self, i, slot, u: ti.template(), stiff, damp):
        """Row i of ``damp`` C u at the state last prepared, with a C that is positive."""
        product = self.vector(0.0)
        for h in range(self.faces.row[i], self.faces.row[i + 1]):
            f = self.faces.entry[h]
            corners, normal, drag = self.faces.corners[f], self.face_normal[f], self.face_drag[f]
            moved = u[corners[0]] + u[corners[1]]
            if ti.static(self.state.dimension == 3):
                moved += u[corners[2]]
            product += drag[0] * moved + (drag[1] * normal.dot(moved)) * normal
        return (damp / self.state.dimension**2) * product

    @ti.func
    def block_on(self, i, slot, stiff, damp):
        """Diagonal block of the same matrix, of particle i."""
        block = self.matrix(0.0)
        for h in range(self.faces.row[i], self.faces.row[i + 1]):
            normal, drag = self.face_normal[self.faces.entry[h]], self.face_drag[self.faces.entry[h]]
            block += drag[1] * normal.outer_product(normal)
            for axis in ti.static(range(self.state.dimension)):
                block[axis, axis] += drag[0]
        return (damp / self.state.dimension**2) * block

    # -- to fields ----------------------------------------------------------------------------------

    @ti.kernel
    def _write_waves(self, table: ti.types.ndarray()):
        for line, m in self.wave:
            self.wave[line, m] = table[line, m]

    @ti.kernel
    def _write_vortices(self, centre: ti.types.ndarray(), core: ti.types.ndarray(), spin: ti.types.ndarray()):
        for k in range(core.shape[0]):
            self.core[k] = core[k]
            for axis in ti.static(range(self.state.dimension)):
                self.centre[k][axis] = centre[k, axis]
            for axis in ti.static(range(3)):
                self.spin[k][axis] = spin[k, axis]


def _spin(vortex: Vortex, dimension: int) -> FloatArray:
    """Angular velocity of the core [rad/s], shape (3,); in 2D about the axis that looks at the viewer."""
    axis = np.array([0.0, 0.0, 1.0] if dimension == 2 else vortex.axis or (0.0, 1.0, 0.0))
    return np.asarray(vortex.speed / vortex.radius * axis / np.linalg.norm(axis))
