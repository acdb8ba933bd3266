"""Steps of a command on stderr, where someone is watching."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from jaxnc.progress import bar


@contextmanager
def progress(total: int) -> Iterator[Callable[[str], None]]:
    """A bar over a number of steps, shown where somebody is watching; yields what is told the name of each step."""
    form = "{desc}{n_fmt}/{total_fmt} |{bar:30}| {elapsed}"
    with bar(total, leave=False, bar_format=form) as shown:
        done = -1

        def step(name: str) -> None:
            nonlocal done
            done += 1
            shown.update(done - shown.n)
            shown.set_description(name)

        yield step
