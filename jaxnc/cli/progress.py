"""Progress on stderr, where someone is watching."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress(total: int) -> Iterator[Callable[[str], None]]:
    """A bar over a number of steps; nothing is shown where stderr is not a terminal.

    Args:
        total: how many steps.

    Yields:
        A function that is called with the name of each step before it begins.
    """
    from tqdm import tqdm

    form = "{desc}{n_fmt}/{total_fmt} |{bar:30}| {elapsed}"
    with tqdm(total=total, leave=False, disable=not sys.stderr.isatty(), bar_format=form) as bar:
        done = -1

        def step(name: str) -> None:
            nonlocal done
            done += 1
            bar.update(done - bar.n)
            bar.set_description(name)

        yield step
