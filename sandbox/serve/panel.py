"""The controls and read-outs beside the picture. All browsers share them."""

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

from sandbox.diagnostics import Measurement
from sandbox.live.budget import Budget
from sandbox.scene.model import IntegratorName, Scene
from sandbox.serve.commands import (
    Command,
    Reset,
    SendRecording,
    SetPause,
    SetShadows,
    SetSolver,
    SetSpeed,
    SetStiffness,
    StepPicture,
)

if TYPE_CHECKING:
    import viser

Ask = Callable[[Command], None]

SPEEDS = {"real time": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1, "1/30": 1.0 / 30.0}
"""Simulated time for a second of real time [1], by what the page calls it."""
LEAST_FACTOR, LARGEST_FACTOR = 0.1, 5.0
"""How much softer and stiffer a body can be made [1]."""
_BUTTONS: dict[str, Command] = {
    "Go": SetPause(False),
    "Pause": SetPause(True),
    "Step": StepPicture(),
    "Reset": Reset(),
}
_MOST_SLIDERS = 12


class Panel:
    """The page's controls; what they are set to is given to ``ask``, as a command."""

    def __init__(self, server: "viser.ViserServer", scene: Scene, shadows: bool, ask: Ask) -> None:
        gui: Any = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label(scene.title or "sandbox")
        gui.main_panel.dock_right()
        self._notice = gui.add_html("", visible=False)
        time = gui.add_button_group("Time", tuple(_BUTTONS), hint="Step: on by one picture. Reset: back to the start.")
        _on_click(time, lambda event: ask(_BUTTONS[event.target.value]))
        speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="real time")
        _on_update(speed, lambda event: ask(SetSpeed(SPEEDS.get(event.target.value, 1.0))))
        self._readings = gui.add_html("")
        with gui.add_folder("Material"):
            self._factors = {name: _add_factor(gui, name, ask) for name in _bodies_with_springs(scene)}
        with gui.add_folder("Solver"):
            self._integrator = gui.add_dropdown(
                "Integrator", tuple(map(str, IntegratorName)), initial_value=str(scene.solver.integrator)
            )
            _on_update(self._integrator, lambda event: ask(SetSolver(integrator=event.target.value)))
            self._dt = gui.add_text("Step [s]", str(scene.solver.dt), hint="The longest step, or auto")
            _on_update(self._dt, lambda event: ask(SetSolver(dt=event.target.value)))
        save = gui.add_button("Save recording", hint="What was done so far, for sandbox run --actions")
        _on_click(save, lambda event: ask(SendRecording(event.client_id)))
        light = gui.add_checkbox("Shadows", shadows)
        _on_update(light, lambda event: ask(SetShadows(bool(event.target.value))))

    def say(self, text: str) -> None:
        """Show a line above all else; none if it is empty."""
        self._notice.content = f'<p id="notice" style="margin:0 0.75em;color:#c92a2a">{escape(text)}</p>'
        self._notice.visible = bool(text)

    def show_solver(self, integrator: str, dt: str) -> None:
        """Show what is really in use."""
        self._integrator.value, self._dt.value = integrator, dt

    def show_unchanged(self, scene: Scene) -> None:
        """Have everything say what the scene says."""
        for slider in self._factors.values():
            slider.value = 1.0
        self.show_solver(str(scene.solver.integrator), str(scene.solver.dt))

    def read_out(self, time: float, measured: Measurement, budget: Budget, paused: bool, lost: float) -> None:
        """Show the state at a time [s], what it costs, and by how much time has fallen behind [s]."""
        energy = measured.energy
        parts = [("kinetic", energy.kinetic), ("elastic", energy.elastic), ("gravity", energy.gravity)]
        parts += [("gas", energy.gas)] if energy.gas else []
        rows = [("time", f"{time:.2f} s")]
        rows += [("speed", "stands still" if paused else f"{budget.real_time_factor:.2f} of real time")]
        rows += [("energy", f"{energy.total:.4g} J")] + [(f"&emsp;{name}", f"{value:.4g} J") for name, value in parts]
        rows += [("largest strain", f"{100.0 * measured.max_strain:.1f} %")]
        rows += [("torn springs", str(measured.torn))] if measured.torn else []
        rows += [("cost", escape(budget.line()))]
        rows += [("behind", f"{lost:.2f} s: too slow for this machine")] if not budget.is_enough else []
        cells = "".join(f'<tr><td style="vertical-align:top;opacity:0.7">{a}</td><td>{b}</td></tr>' for a, b in rows)
        self._readings.content = f'<table id="readings" style="margin:0 0.75em;font-size:0.85em">{cells}</table>'


def _add_factor(gui: Any, body: str, ask: Ask) -> Any:
    hint = "Stiffness, in times of what the scene says"
    slider = gui.add_slider(body, LEAST_FACTOR, LARGEST_FACTOR, 0.05, 1.0, hint=hint)
    _on_update(slider, lambda event: ask(SetStiffness(body, event.target.value)))
    return slider


def _bodies_with_springs(scene: Scene) -> list[str]:
    """Names of bodies that can be made softer, as many as a page can take."""
    materials = [(body.name, body.material) for body in scene.bodies]
    springy = [name for name, one in materials if one.stiffness is not None or one.youngs_modulus is not None]
    return springy[:_MOST_SLIDERS]


def _on_click(button: Any, act: Callable[[Any], None]) -> None:
    async def clicked(event: Any) -> None:
        act(event)

    button.on_click(clicked)


def _on_update(control: Any, act: Callable[[Any], None]) -> None:
    """Call ``act`` where a browser changed a control, not where this program did."""

    async def updated(event: Any) -> None:
        if event.client is not None:
            act(event)

    control.on_update(updated)
