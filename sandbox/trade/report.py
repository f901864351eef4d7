"""What the stability study leaves: a folder with JSON, and the map as PNG and CSV."""

from dataclasses import asdict, dataclass
from pathlib import Path

from sandbox.output.folder import RunFolder
from sandbox.scene.load import to_toml
from sandbox.scene.model import IntegratorName, Scene
from sandbox.trade.progress import progress_bar
from sandbox.trade.stability import StableStep, stable_steps
from sandbox.trade.stability_map import draw, stability_map, write_csv


@dataclass(frozen=True)
class StabilityOptions:
    """What to look at, and where to leave it."""

    name: str
    """Name of the scene: names the folder."""
    schemes: tuple[IntegratorName, ...]
    horizon: float | None
    """Time over which steps must hold [s]; None for the default."""
    draws_map: bool
    out: Path | None
    """Folder; outputs/NAME-stability by default."""
    arch: str
    threads: int | None

    @property
    def folder(self) -> Path:
        return self.out or Path("outputs") / f"{self.name}-stability"


def report_stability(scene: Scene, options: StabilityOptions, silent: bool) -> tuple[list[StableStep], Path]:
    """Study a scene; the rows of the table, and the folder that holds them.

    Raises SceneError where the scene cannot be built; nothing is left then.
    """
    maps = ("stability_map.csv", "stability_map.png") if options.draws_map else ()
    folder = RunFolder(options.folder, ("stability.json", "scene.toml", *maps))
    with folder.discarded_on_failure():
        with progress_bar(silent) as progress:
            rows = stable_steps(
                scene,
                options.schemes,
                options.horizon,
                options.arch,
                options.threads,
                lambda done, name: progress(done, f"stable dt: {name}"),
            )
            if options.draws_map:
                points = stability_map(
                    scene, options.arch, options.threads, lambda done: progress(done, "map of stability")
                )
                write_csv(points, folder.partial / "stability_map.csv")
                draw(points, folder.partial / "stability_map.png", scene.title or options.name)
        folder.write_text("scene.toml", to_toml(scene))
        folder.write_json("stability.json", {"name": options.name, "schemes": [asdict(row) for row in rows]})
        folder.publish()
    return rows, folder.path
