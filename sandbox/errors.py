"""Errors that a user can meet. Each message is one line: where, what, what to do."""


class SandboxError(Exception):
    """Base of every error that the sandbox raises on purpose; its text is one line."""

    exit_code = 1

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


class SceneError(SandboxError, ValueError):
    """The input is wrong: a scene, a setting, a checkpoint or an output folder."""

    exit_code = 2


class RuntimeUnavailableError(SceneError):
    """The asked-for architecture or precision is not there on this machine."""


class DivergedError(SandboxError, ArithmeticError):
    """The simulation left its bounds. The state before it is kept.

    Attributes
    ----------
    time : simulated time of the first step that left its bounds [s]
    stable_dt : largest stable step at the last good state [s]
    element : what left its bounds first, as the scene names it; empty where that was not looked into
    particles : its particles, in the scene's order
    """

    exit_code = 3

    def __init__(
        self, message: str, time: float, stable_dt: float, element: str = "", particles: tuple[int, ...] = ()
    ) -> None:
        super().__init__(message)
        self.time = time
        self.stable_dt = stable_dt
        self.element = element
        self.particles = particles
