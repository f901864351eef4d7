"""Builds for a scene exactly the parts that it needs."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbox import runtime, stability
from sandbox.actions.grips import Grips
from sandbox.actions.loads import Loads
from sandbox.contact.colliders import build_colliders
from sandbox.contact.moving import Carrier
from sandbox.contact.neighbours import ContactSetup
from sandbox.contact.particle_contact import ParticleContact
from sandbox.diagnostics import Diagnostics
from sandbox.forces.changing_springs import changing_springs, memory_name
from sandbox.forces.gravity import Gravity
from sandbox.forces.pressure import Pressure
from sandbox.forces.springs import plain_springs
from sandbox.forces.tears import Tears
from sandbox.forces.wind import WindForce
from sandbox.integrators.build import build_stepper, stage_slots, takes_slices
from sandbox.integrators.schemes import Scheme
from sandbox.integrators.stepper import Stepper
from sandbox.ledger import Ledger
from sandbox.parts import Parts
from sandbox.scene.assemble import Assembly, combine_bodies
from sandbox.scene.spring_set import Behaviour
from sandbox.state import ParticleState

FloatArray = NDArray[np.float64]
Memory = dict[str, FloatArray]

MOST_NEIGHBOURS = 4096
"""Most neighbours of a particle that contact makes room for."""
_MANY_PARTICLES = 200_000


@dataclass
class Pipeline:
    """What of a simulation lives in Taichi, and dies when Taichi is started anew."""

    tree: Any
    state: ParticleState
    parts: Parts
    stepper: Stepper
    diagnostics: Diagnostics
    remembering: list[Any]
    """Parts with a memory beyond positions and velocities."""
    loading: list[Any]
    """Parts that upload numbers of the scene."""

    def reload(self, assembly: Assembly) -> None:
        """Upload other masses, springs and carried particles of the same bodies; state and compiled code stay."""
        state = self.state.read()
        for law in self.parts.laws:
            if hasattr(law, "numbers"):
                law.springs = assembly.spring_set.chosen(law.numbers)
        for part in self.loading:
            part.load(assembly)
        self.state.write(*state)

    def memory(self) -> Memory:
        """What all parts remember."""
        return {name: values for part in self.remembering for name, values in part.memory().items()}

    def remember(self, memory: Memory) -> None:
        """Set what all parts remember."""
        for part in self.remembering:
            part.remember(memory)

    def keep(self) -> None:
        """Keep the state as the last good one."""
        for part in [self.state, *self.remembering]:
            part.keep()

    def restore(self) -> None:
        """Go back to the last good state."""
        for part in [self.state, *self.remembering]:
            part.restore()

    def set_time(self, time: float) -> None:
        """Put colliders where they are at ``time`` [s]."""
        for mover in self.parts.movers:
            mover.set_time(time)

    def alarm(self) -> str | None:
        """What a part says is wrong, if any does."""
        calls = (law.alarm() for law in self.parts.laws if hasattr(law, "alarm"))
        return next((text for text in calls if text), None)


def build_pipeline(assembly: Assembly, scheme: Scheme, serial: bool, neighbours: int) -> Pipeline:
    """Fields and kernels for just what the scene names; ``neighbours`` is the room for contact."""
    builder = runtime.fields_builder()
    try:
        return _build(builder, assembly, scheme, serial, neighbours)
    except BaseException:
        runtime.give_up(builder)
        raise


def _build(builder: Any, assembly: Assembly, scheme: Scheme, serial: bool, neighbours: int) -> Pipeline:
    scene = assembly.scene
    predicts = scheme.predicts_velocity and _sees_velocity(assembly)
    state = ParticleState(builder, assembly, predicts, stage_slots(scheme))
    ledger = Ledger(builder, state.count, state.dimension) if scene.diagnostics.ledger else None
    tears = Tears(builder, assembly.spring_count) if assembly.can_tear else None
    parts = Parts(tears=[] if tears is None else [tears], ledger=[] if ledger is None else [ledger])
    loads: list[Any] = [state]
    if scene.gravity is not None and any(scene.gravity):
        parts.laws.append(Gravity(state, scene.gravity))
    for law in _springs(builder, assembly, state, tears, ledger, takes_slices(scheme)):
        parts.laws.append(law)
        loads.append(law)
    if assembly.gases:
        parts.laws.append(Pressure(builder, assembly, state, tears, ledger))
        loads.append(parts.laws[-1])
    if scene.wind is not None and len(assembly.wind_faces.faces):
        parts.laws.append(WindForce(builder, assembly, state, tears, ledger))
        loads.append(parts.laws[-1])
    if assembly.plan.grips:
        parts.grips.append(Grips(builder, assembly.plan.grips, state))
    if assembly.plan.loads:
        parts.loads.append(Loads(builder, assembly.plan.pushes, assembly.plan.shakes, state))
    parts.laws.extend([*parts.grips, *parts.loads])
    solids = build_colliders(builder, assembly, state)
    parts.colliders.extend(solids.solids)
    parts.movers.extend([] if solids.motions is None else [solids.motions])
    if solids.motions is not None and len(assembly.carried.particles):
        parts.carriers.append(Carrier(builder, solids.motions, state.count, assembly.carried))
        loads.append(parts.carriers[-1])
    for solid in solids.solids if ledger is not None else ():
        solid.booked, solid.ledger = True, ledger
    setup = contact_setup(assembly, neighbours) if assembly.meets_particles else None
    if setup is not None:
        parts.contact.append(ParticleContact(builder, setup, state, ledger))
    diagnostics = Diagnostics(builder, state, parts, assembly.cells)
    stepper = build_stepper(builder, scheme, state, parts, assembly, serial)
    tree = builder.finalize()
    loading = [part for part in [*loads, *solids.parts, stepper, diagnostics] if hasattr(part, "load")]
    for part in loading:
        part.load(assembly)
    if setup is not None:
        parts.contact[0].load(setup)
    remembering = [part for part in [*parts.laws, *parts.tears, *parts.ledger, stepper] if hasattr(part, "memory")]
    return Pipeline(tree, state, parts, stepper, diagnostics, remembering, loading)


def first_neighbours(assembly: Assembly) -> int:
    """Neighbours a particle that contact first has room for; twice as many whenever that is too few.

    Touching balls of one size have at most 12, bodies pressed into each other several times as many.
    """
    if assembly.dimension == 2:
        return 24
    return 64 if assembly.particle_count <= _MANY_PARTICLES else 32


def contact_setup(assembly: Assembly, neighbours: int) -> ContactSetup:
    """What contact between particles must know of a scene, with room for ``neighbours`` a particle."""
    scene = assembly.scene
    restitution, friction = combine_bodies([body.material for body in scene.bodies])
    return ContactSetup(
        radii=assembly.radii,
        body=assembly.particle_body,
        family=assembly.families[assembly.particle_body],
        self_contact=np.array([body.self_contact for body in scene.bodies]),
        rest_positions=assembly.positions,
        restitution=restitution,
        friction=friction,
        skin=scene.contact.skin * float(assembly.radii.max()),
        capacity=neighbours,
        gravity=float(np.linalg.norm(scene.gravity or 0.0)),
    )


def _sees_velocity(assembly: Assembly) -> bool:
    """True where some force depends on velocities."""
    return bool(assembly.spring_set.damping.any()) or assembly.scene.wind is not None


def _springs(
    builder: Any, assembly: Assembly, state: ParticleState, tears: Tears | None, ledger: Ledger | None, slices: bool
) -> Any:
    """One law for every behaviour that springs of the scene have; plain ones by ``slices`` if that pays."""
    springs = assembly.spring_set
    for behaviour, numbers in springs.behaviours():
        chosen = springs.chosen(numbers)
        if behaviour == Behaviour(tension_only=False, yields=False, tears=False):
            law = plain_springs(builder, chosen, state, slices)
        else:
            law = changing_springs(builder, chosen, state, numbers, behaviour, tears, ledger)
        law.numbers = numbers
        yield law


def network_of(assembly: Assembly, memory: Memory | None = None) -> stability.SpringNetwork:
    """What the stability limit of a scene depends on: at the start, or with what its parts remember."""
    springs, memory = assembly.spring_set, memory or {}
    rest_lengths, stiffness = springs.rest_lengths.copy(), springs.stiffness.copy()
    for behaviour, numbers in springs.behaviours():
        name = memory_name(numbers)
        if (behaviour.yields or behaviour.tears) and f"{name}.stiffness" in memory:
            rest_lengths[numbers] = memory[f"{name}.rest_length"]
            stiffness[numbers] = memory[f"{name}.stiffness"]
    return stability.SpringNetwork(
        inverse_masses=assembly.inverse_masses,
        springs=assembly.springs,
        rest_lengths=rest_lengths,
        stiffness=stiffness,
        damping=np.where(stiffness > 0.0, springs.damping, 0.0),
        gas=stability.GasStiffness.of(assembly.gas_faces, assembly.gases, memory.get("gas.amount")),
    )
