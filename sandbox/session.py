"""A simulation that is touched while it runs, and a record of it that runs again to the same bits.

Time goes on by whole ticks, a quarter of a picture each: what is done to bodies happens between two of them. So a
recording, the actions and the number of ticks, says all there is, and ``sandbox run SCENE --actions FILE`` takes the
same steps.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from sandbox import __version__
from sandbox.actions.actor import check_live
from sandbox.actions.choosing import Grip
from sandbox.actions.grips import Segment
from sandbox.errors import SceneError
from sandbox.recording import ActionFile, Header, begin_of, fingerprint, write
from sandbox.scene.load import check_action, describe
from sandbox.scene.model import Action, Grab, Interaction, Scene, Waypoint
from sandbox.scene.model.base import LARGEST
from sandbox.simulation import Simulation

FloatArray = NDArray[np.float64]

TICKS_A_PICTURE = 4
_LATER = 1e9
"""End of a grab that has not ended [s]."""
_ACTION: TypeAdapter[Any] = TypeAdapter(Action)


class LiveGrip:
    """Particles in a hand; made by :meth:`Session.grab`."""

    def __init__(self, simulation: Simulation, number: int, grip: Grip, first_end: float) -> None:
        self._simulation, self.number, self._grip = simulation, number, grip
        self.first_end = first_end
        """When it can open [s]: a hand that opens before time went on still holds for a tick."""
        self.path: list[Waypoint] = []
        self.goal = grip.middle
        """Where it is led by now [m]."""
        self.target = grip.middle
        """Where it is to be led [m]."""

    @property
    def body(self) -> str:
        """Whose particles they are."""
        return self._simulation.scene.bodies[self._grip.body].name

    def took(self, grip: Grip) -> None:
        """It holds these: what was seen when it was told to may have been pinned before time went on."""
        if self.target is self.goal:
            self.target = grip.middle
        self._grip, self.goal = grip, grip.middle

    @property
    def point(self) -> FloatArray:
        """Mean of the places of the particles now [m], shape (d,)."""
        simulation = self._simulation
        positions = simulation.assembly.internal_order(simulation.positions())
        return np.asarray(positions[self._grip.particles].mean(axis=0))


class Session:
    """A scene that is played with. One thread at a time may use it.

    Parameters
    ----------
    scene : what to simulate
    arch, precision, threads : as :class:`sandbox.Simulation` has them

    Raises SceneError where the scene cannot be built.
    """

    def __init__(
        self, scene: Scene, *, arch: str = "cpu", precision: str | None = None, threads: int | None = None
    ) -> None:
        live = scene if scene.interaction is not None else scene.model_copy(update={"interaction": Interaction()})
        self.simulation = Simulation(live, arch=arch, precision=precision, threads=threads)
        assert self.simulation.acting is not None
        self._acting = self.simulation.acting
        self.tick = 1.0 / (scene.render.fps * TICKS_A_PICTURE)
        """Time of a tick [s]."""
        self.ticks = 0
        """Ticks since the start."""
        self._given = len(scene.actions)
        self._fingerprint = fingerprint(scene)
        self._grips: list[LiveGrip] = []
        self._stiffness: dict[str, float] = {}

    # -- time ---------------------------------------------------------------------------------------

    def advance(self, ticks: int = 1) -> None:
        """Go on by some ticks; grips are where they were dragged to at the end of them.

        Raises DivergedError where the state leaves its bounds; it is then the last good one.
        """
        self._see_what_hands_took()
        end = (self.ticks + ticks) * self.tick
        for grip in self._grips:
            self._lead(grip, end)
        for _ in range(ticks):
            self.simulation.advance_to((self.ticks + 1) * self.tick)
            self.ticks += 1

    def reset(self) -> None:
        """Back to the start of the scene; the recording begins anew."""
        self._grips.clear()
        self._stiffness.clear()
        self._acting.forget(self._given)
        self.simulation.restore()
        self.ticks = 0

    # -- hands --------------------------------------------------------------------------------------

    def grab(
        self, point: Sequence[float], direction: Sequence[float] | None = None, radius: float | None = None
    ) -> LiveGrip | None:
        """Take the particles nearest to a point [m], or those that a ray from there meets first, and what is near.

        None where there are none, or all hands are full. Raises SceneError where the numbers are none.
        """
        if self._acting.free_hands <= 0:
            return None
        given = {"kind": "grab", "start": self.simulation.time, "end": _LATER, "point": self._vector("point", point)}
        if direction is not None:
            given["direction"] = self._vector("direction", direction)
        action = _action(given | ({} if radius is None else {"radius": radius}))
        grip = self._acting.gripped(action)
        if grip is None:
            return None
        live = LiveGrip(self.simulation, self._acting.act(action), grip, (self.ticks + 1) * self.tick)
        self._grips.append(live)
        return live

    def drag(self, grip: LiveGrip, target: Sequence[float]) -> None:
        """Lead a grip to a place [m] by the end of the next advance. Raises SceneError where it is none."""
        grip.target = np.array(self._vector("target", target))

    def release(self, grip: LiveGrip) -> None:
        """Open a hand; a grip that is open already stays so."""
        if grip in self._grips:
            self._grips.remove(grip)
            self._acting.end(grip.number, self._ended(grip))

    def _ended(self, grip: LiveGrip) -> Grab:
        action = self.simulation.scene.actions[grip.number]
        assert isinstance(action, Grab)
        return action.model_copy(update={"end": max(self.simulation.time, grip.first_end), "path": tuple(grip.path)})

    def _see_what_hands_took(self) -> None:
        for grip in self._grips:
            taken = self._acting.actor.taken.get(grip.number)
            if taken is not None and not grip.path:
                grip.took(taken)

    def _lead(self, grip: LiveGrip, end: float) -> None:
        now = self.simulation.time
        # Where time did not go on as far as was asked for, the hand is still on its way there.
        if np.array_equal(grip.target, grip.goal) or (grip.path and grip.path[-1].time > now):
            return
        action = self.simulation.scene.actions[grip.number]
        assert isinstance(action, Grab)
        if now > action.start and (not grip.path or grip.path[-1].time < now):
            grip.path.append(Waypoint(time=now, position=tuple(grip.goal.tolist())))
        grip.path.append(Waypoint(time=end, position=tuple(grip.target.tolist())))
        if now > action.start:
            self._acting.lead(grip.number, Segment(now, end, grip.goal, grip.target))
        else:
            # It is taken in the step to come, and led at once.
            self._acting.amend(grip.number, action.model_copy(update={"path": tuple(grip.path)}))
        grip.goal = grip.target

    # -- all else -----------------------------------------------------------------------------------

    def act(self, action: Action | Mapping[str, Any]) -> None:
        """Do something now or later: an action as scenes have it. Raises SceneError where it cannot be done live."""
        if isinstance(action, Mapping):
            action = _action(action)
        assert not isinstance(action, Mapping)
        check_live(action)
        check_action(self.simulation.scene, action)
        begins = begin_of(action)
        if begins < self.simulation.time:
            raise SceneError(f"action: begins at {begins:g} s, which is over by {self.simulation.time:g} s")
        if not self._acting.has_room(action):
            full = (
                "all hands are full" if isinstance(action, Grab) else f"no room for one more {action.kind} at that time"
            )
            raise SceneError(f"action: {full}; interaction says how much room there is")
        self._acting.act(action)

    def change_solver(self, integrator: str | None = None, dt: float | str | None = None) -> None:
        """Solve the scene otherwise from now on; compiles what that needs, for seconds."""
        given = {"integrator": integrator, "dt": dt}
        self.act({"kind": "solver", "time": self.simulation.time} | {k: v for k, v in given.items() if v is not None})

    def scale_material(self, body: str, stiffness: float) -> None:
        """Have a body's springs so many times as stiff as the scene says from now on [1].

        Raises SceneError where there is no such body, or its springs cannot be so stiff.
        """
        if not (isinstance(stiffness, float | int) and 0.0 < stiffness <= LARGEST):
            raise SceneError(f"stiffness: must be a number > 0 and at most {LARGEST:g}")
        if not any(body == one.name for one in self.simulation.scene.bodies):
            raise SceneError("body: there is none of that name")
        factor = stiffness / self._stiffness.get(body, 1.0)
        if factor == 1.0:
            return
        kind = "stiffen" if factor > 1.0 else "soften"
        self.act({"kind": kind, "time": self.simulation.time, "body": body, "factor": factor})
        self._stiffness[body] = stiffness

    def _vector(self, name: str, values: Sequence[float]) -> tuple[float, ...]:
        """What a front end gives as a place or a direction [m]. Raises SceneError where it is none in this scene."""
        numbers = tuple(values) if isinstance(values, Sequence | np.ndarray) else ()
        dimension = self.simulation.scene.dimension
        if len(numbers) != dimension or not all(
            isinstance(n, float | int | np.number) and abs(n) <= LARGEST for n in numbers
        ):
            raise SceneError(f"{name}: must be {dimension} numbers of at most {LARGEST:g}")
        return tuple(float(number) for number in numbers)

    # -- the record ---------------------------------------------------------------------------------

    def recording(self) -> ActionFile:
        """All that was done since the start, so far."""
        simulation = self.simulation
        actions = list(simulation.scene.actions)
        for grip in self._grips:
            actions[grip.number] = self._ended(grip)
        return ActionFile(
            recording=Header(
                title=simulation.scene.title,
                tick=self.tick,
                ticks=self.ticks,
                duration=simulation.scene.duration,
                precision=simulation.precision,
                scene_sha256=self._fingerprint,
                state_sha256=simulation.state_hash(),
                version=__version__,
            ),
            interaction=simulation.scene.interaction,
            actions=tuple(actions[self._given :]),
        )

    def write_recording(self, path: str | os.PathLike[str]) -> None:
        """Write the record as TOML; the file appears once it is whole."""
        write(Path(path), self.recording())


def _action(given: Mapping[str, Any]) -> Any:
    """An action as scenes have it. Raises SceneError where it is none."""
    try:
        return _ACTION.validate_python(dict(given))
    except ValidationError as error:
        raise SceneError(describe(error, dict(given), "action", {})) from None
