"""What a second of real time buys: how many steps fit, and the step that would hold real time."""

from dataclasses import dataclass

from sandbox.live.pace import Pace


@dataclass(frozen=True)
class Budget:
    """What time goes to, and whether it is enough."""

    picture: float
    """Wall time of a picture [s]."""
    simulation: float
    """Wall time that the simulation of a picture's time takes at the speed asked for [s]; 0 while not known."""
    steps: int
    """Steps that make up a picture's time at the speed asked for."""
    dt: float
    """Longest step now [s]."""
    stable_dt: float
    """Largest stable step of the integrator at the start [s]; infinite where it has none."""
    real_time_factor: float
    """Simulated seconds a second of wall time, lately [1]."""
    speed: float
    """What was asked for [1]."""

    @classmethod
    def of(cls, pace: Pace, dt: float, stable_dt: float) -> "Budget":
        """What a pace has found, for steps of at most ``dt`` [s]."""
        ticks = pace.picture * pace.speed / pace.tick
        steps = max(1, round(ticks * -(-pace.tick // (dt * (1.0 + 1e-9)))))
        return cls(
            picture=pace.picture,
            simulation=pace.tick_cost * ticks,
            steps=steps,
            dt=dt,
            stable_dt=stable_dt,
            real_time_factor=pace.real_time_factor,
            speed=pace.speed,
        )

    @property
    def is_enough(self) -> bool:
        """True where the simulation fits into the time of a picture."""
        return self.simulation <= self.picture

    @property
    def fitting_dt(self) -> float:
        """Step at which the simulation would just fit, at what a step costs now [s]."""
        return self.dt * max(self.simulation / self.picture, 0.0)

    def line(self) -> str:
        """One line that says it."""
        if self.simulation == 0.0:
            return "not known yet"
        cost = f"{self.steps} steps of {1e3 * self.dt:.3g} ms take {1e3 * self.simulation:.3g} ms"
        cost += f" of the {1e3 * self.picture:.3g} ms of a picture"
        if self.is_enough:
            return cost
        wish = f"; real time needs steps of {1e3 * self.fitting_dt:.3g} ms"
        if self.stable_dt < float("inf"):
            wish += f", stable are {1e3 * self.stable_dt:.3g} ms"
        return cost + wish
