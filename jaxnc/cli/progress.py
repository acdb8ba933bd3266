"""Steps of a command on stderr, where someone is watching."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from jaxnc.progress import bar


@contextmanager
def progress(total: int) -> Iterator[Callable[[str], None]]:
    """A bar over a number of steps; nothing is shown where nobody is watching.

    Yields:
        A function that is called with the name of each step before it begins.
    """
    form = "{desc}{n_fmt}/{total_fmt} |{bar:30}| {elapsed}"
    with bar(total, leave=False, bar_format=form) as shown:
        done = -1

        def step(name: str) -> None:
            nonlocal done
            done += 1
            shown.update(done - shown.n)
            shown.set_description(name)

        yield step
