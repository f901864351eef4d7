"""What a window says of a running scene, in lines that fit its panel."""

import math
import textwrap

from sandbox.live.budget import Budget
from sandbox.live.player import BUTTONS, Player
from sandbox.render.ggui.messages import Button, Panel, Text, Widget

READINGS = (0.01, 0.015, 0.29, 0.55)
CONTROLS = (0.80, 0.015, 0.19, 0.55)
"""Left, top, width and height of the panels, in parts of the window."""
_LETTER, _MARGIN = 7.0, 40.0
"""Width of a letter, and of what is beside the text of a panel [pixels]."""
ALARM = (1.0, 0.45, 0.35)
CAUTION = (1.0, 0.8, 0.3)
TUNING = "no step of this integrator is fast enough; `sandbox tune SCENE --budget 16ms` finds settings that are"
HELP = (
    "left mouse: grab, drag",
    "f: poke",
    "right mouse, arrows: turn",
    "middle mouse: shift",
    "w, s: nearer, farther",
    "q: end",
)


def panels(player: Player, legend: str = "") -> tuple[Panel, Panel]:
    """The panels as they are now: readings, and what to do; ``legend`` says what colours show."""
    columns = max(20, int((READINGS[2] * player.view.size[0] - _MARGIN) / _LETTER))
    lines = [*_time(player, columns), *_energies(player), *([Text(legend)] if legend else [])]
    lines += [Text(line, ALARM) for line in textwrap.wrap(player.message, columns)]
    controls: list[Widget] = [Button(label) for label in BUTTONS]
    controls += [Text(line) for line in HELP]
    return Panel("sandbox", READINGS, tuple(lines)), Panel("hands", CONTROLS, tuple(controls))


def _time(player: Player, columns: int) -> list[Widget]:
    simulation, pace = player.session.simulation, player.pace
    solver = simulation.scene.solver
    stable = simulation.initial_stable_dt
    budget = Budget.of(pace, simulation.dt, stable)
    lines: list[Widget] = [Text(f"t = {simulation.time:.3f} s")]
    if pace.paused:
        lines.append(Text("paused", CAUTION))
    else:
        wanted = "" if pace.speed == 1.0 else f", {pace.speed:g}x wanted"
        is_behind = not budget.is_enough
        lines.append(Text(f"{pace.real_time_factor:.2f}x real time{wanted}", CAUTION if is_behind else None))
    lines += [Text(line, None if budget.is_enough else CAUTION) for line in textwrap.wrap(budget.line(), columns)]
    if not budget.is_enough and budget.fitting_dt > stable:
        lines += [Text(line, CAUTION) for line in textwrap.wrap(TUNING, columns)]
    if pace.lost > 0.0:
        lines.append(Text(f"behind the clock by {pace.lost:.2f} s", CAUTION))
    limit = f", stable up to {1e3 * stable:.3g} ms" if math.isfinite(stable) else ""
    used = f"{solver.integrator}, dt {1e3 * simulation.dt:.3g} ms{limit}"
    lines += [Text(line) for line in textwrap.wrap(used, columns)]
    return lines


def _energies(player: Player) -> list[Widget]:
    measured = player.session.simulation.measure()
    energy = measured.energy
    parts = [("kinetic", energy.kinetic), ("elastic", energy.elastic), ("gravity", energy.gravity)]
    parts += [("gas", energy.gas)] if energy.gas else []
    lines: list[Widget] = [Text(f"{name:8s} {value:11.4g} J") for name, value in [*parts, ("total", energy.total)]]
    lines.append(Text(f"strain {100.0 * measured.max_strain:9.3g} %"))
    if measured.torn:
        lines.append(Text(f"torn springs {measured.torn}"))
    return lines
