"""A bar on standard error for studies: how far, and how long still."""

import contextlib
from collections.abc import Callable, Iterator

Progress = Callable[[float, str], None]
"""Takes the part that is done [1] and what was done last."""


@contextlib.contextmanager
def progress_bar(silent: bool) -> Iterator[Progress]:
    """Live bar with the time left; nothing where it is to be silent."""
    if silent:
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("passed, left"), TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
    )  # fmt: skip
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda done, what: bar.update(task, completed=done, description=what)
