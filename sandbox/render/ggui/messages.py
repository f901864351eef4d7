"""What a simulation and its drawing process tell each other."""

from dataclasses import dataclass

from sandbox.render.camera import FlatCamera, PinholeCamera
from sandbox.render.ggui.shared import Layout
from sandbox.scene.appearance import Appearance, FloatArray

AnyCamera = PinholeCamera | FlatCamera


@dataclass(frozen=True)
class Task:
    """What a drawing process needs once, at its start."""

    appearance: Appearance
    camera: AnyCamera
    """The light comes from where this one has it, wherever later cameras look from."""
    colormap: FloatArray | None
    """sRGB in [0, 1], shape (count, 3); None where colours are the bodies' own."""
    layout: Layout
    """Of the shared arrays: positions, hidden, values, picture."""
    threads: int | None
    title: str = ""
    is_visible: bool = False
    """Whether there is a window on the screen; else pictures go into the shared array."""


@dataclass(frozen=True)
class Text:
    """A line of a panel."""

    text: str
    color: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Button:
    """Something to click at."""

    label: str


Widget = Text | Button


@dataclass(frozen=True)
class Panel:
    """A box of widgets over the picture."""

    title: str
    place: tuple[float, float, float, float]
    """Left, top, width and height when it first appears, in parts of the window."""
    widgets: tuple[Widget, ...]


@dataclass(frozen=True)
class Frame:
    """One picture to draw: of the positions in the shared arrays."""

    time: float
    """Of colliders that move [s]."""
    slot: int = 0
    """Which of the copies of the positions."""
    camera: AnyCamera | None = None
    """A new view; None: as before."""
    hides: bool = False
    """True where what is hidden has changed."""
    panels: tuple[Panel, ...] = ()


@dataclass(frozen=True)
class KeyEvent:
    """A key or mouse button goes down, or up."""

    key: str
    is_press: bool


@dataclass(frozen=True)
class Input:
    """What was done in a window since the picture before."""

    cursor: tuple[float, float] = (0.5, 0.5)
    """In parts of the window, from its lower left corner."""
    held: frozenset[str] = frozenset()
    """Mouse buttons that are down: LMB, MMB, RMB."""
    events: tuple[KeyEvent, ...] = ()
    clicked: frozenset[str] = frozenset()
    """Labels of buttons."""
    size: tuple[int, int] = (0, 0)
    """Of the window [pixels]."""
    is_open: bool = True
    """False once the window was closed."""


@dataclass(frozen=True)
class Ready:
    """The first answer: there is a driver, and it draws."""


@dataclass(frozen=True)
class Refused:
    """The first answer where there is none."""

    reason: str


@dataclass(frozen=True)
class Failed:
    """The last answer where something went wrong in the drawing itself."""

    reason: str
