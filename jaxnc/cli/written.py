"""Files that an analysis leaves behind."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from jaxnc.cli.analysis import Analysis
from jaxnc.cli.progress import progress
from jaxnc.cli.question import stem
from jaxnc.io.tables import to_csv, to_npz
from jaxnc.io.target import folder
from jaxnc.reporting.verdict import File, Verdict
from jaxnc.vehicle.report import SuspensionReport


def write_files(
    analysis: Analysis,
    out: str | Path,
    outputs: Sequence[str],
    pictures: bool = True,
    page: bool = True,
    animation: bool = False,
    suspensions: Sequence[SuspensionReport] = (),
) -> list[tuple[Path, str]]:
    """Write tables and pictures of an analysis, with a progress bar where someone is watching: each with what it is."""
    from jaxnc import viz

    base = folder(out) / stem(analysis.mechanism.name)
    motion = analysis.motion
    top = motion.system.topology
    traced = [name for name in outputs if name in (*top.points, *(m.name for m in top.markers))]
    good = np.flatnonzero(np.asarray(motion.converged))

    def at(ending: str) -> Path:
        return base.with_name(base.name + ending)

    tasks: list[tuple[Path, str, Callable[[Path], object]]] = [
        (at(".csv"), "every pose, as a table", lambda p: to_csv(motion, p)),
        (at(".npz"), "the same as arrays, for numpy", lambda p: to_npz(motion, p)),
    ]
    if suspensions:
        tasks.append((at("-report.json"), "camber, toe and the rest with gradients, as data", suspensions[0].to_json))
    if pictures and len(good):
        shown = int(good[len(good) // 8])  # not the first: many mechanisms start where their bars lie in line
        tasks.append((at(".png"), "the mechanism, drawn", lambda p: viz.draw(motion, pose=shown, path=p, trace=traced)))
    if pictures and len(good) > 1:
        for found in suspensions:
            what = f"toe, camber, caster and the rest over {found.over}"
            tasks.append((at("-plots.png" if found.travels else "-steering.png"), what, found.plot))
        if not suspensions:
            what = f"{', '.join(outputs)} over the input"
            tasks.append((at("-plots.png"), what, lambda p: viz.plot(motion, *outputs, path=p)))
        if page:
            what = "a page where it is dragged and changed, opens in any browser"
            tasks.append((at(".html"), what, lambda p: viz.to_html(motion, p, trace=traced, model=analysis.mechanism)))
        if animation:
            tasks.append((at(".gif"), "the motion", lambda p: viz.animate(motion, p, trace=traced)))
    with progress(len(tasks)) as step:
        for path, _, task in tasks:
            step(f"writing {path.name}")
            task(path)
    return [(path, what) for path, what, _ in tasks]


def listing(files: Sequence[tuple[Path, str]], verdict: Verdict) -> str:
    """The files that were written, one a line; entered into the verdict as well."""
    verdict.files += [File(path=str(path), what=what) for path, what in files]
    width = max(len(str(path)) for path, _ in files)
    return "\n".join(["  files:", *(f"    {str(path).ljust(width)}  {what}" for path, what in files)])
