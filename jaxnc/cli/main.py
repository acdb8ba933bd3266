"""The command `jaxnc`: what it understands, and how it ends.

Compiled programs are kept between processes, so that only the first one waits for the compiler.
"""

import _thread
import argparse
import contextlib
import importlib
import io
import json
import os
import re
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

import jaxnc
from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError, JaxncError, MechanismError, OutputError, nearest
from jaxnc.io.target import folder as made
from jaxnc.process import cache_folder
from jaxnc.reporting.verdict import Verdict, parse_expectation, schema

_ENDINGS = ("-cache", "-atime")  # of the files that JAX writes


@public
def cache(folder: str | Path | None = None) -> Path | None:
    """Keep compiled programs on disk, and use those of earlier processes, without a word from XLA about it.

    Call it before the first calculation; what was compiled earlier in the process is not kept. This sets JAX's own
    ``jax_compilation_cache_dir`` (and keeps programs however quickly they were compiled), and the least severe message
    that XLA prints in this process to a fatal one, unless you have set ``jax_logging_level``: it prints pages of
    errors that are none whenever a program is read. See docs/batches.md for what is kept and what is not.

    Args:
        folder: where; made if it is not there. If not given, what the environment says in ``JAXNC_CACHE``, or JAX's
            own setting, or the folder of the user's caches, ``~/.cache/jaxnc`` on Linux.

    Returns:
        The folder; None where the environment says ``JAXNC_CACHE=off`` and no folder is given.

    Raises:
        OutputError: the folder cannot be written.
    """
    import jax

    told = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    where = Path(folder).expanduser() if folder is not None else cache_folder(os.environ, sys.platform, told)
    if where is None:
        jax.config.update("jax_enable_compilation_cache", False)
        return None
    if where == told:
        _quiet()
        return Path(where)
    trim(made(where))
    _quiet()
    jax.config.update("jax_compilation_cache_dir", str(where))
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        # An analysis compiles some two dozen programs, half a megabyte in all: everything is worth keeping.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    return Path(where)


def _quiet() -> None:
    """Silence what is said when programs are read back, and what need not be done about one that is damaged."""
    import jax

    # A damaged entry or a full disk: JAX compiles anew, and there is nothing that anyone need do.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
    # XLA tells at length, for every program read, that it was compiled for features that no processor has. Its level
    # is read from the environment when jax is imported; later it follows JAX's own, and stays when that is put back.
    level = jax.config.jax_logging_level  # pyright: ignore[reportAttributeAccessIssue]
    if level in (None, "", "NOTSET"):
        jax.config.update("jax_logging_level", "CRITICAL")
        jax.config.update("jax_logging_level", level)


def trim(where: Path, largest: int = 500_000_000) -> None:
    """Remove the programs that were not used for longest, until the rest is half of what is allowed."""
    try:
        files = [(f.stat(), f) for f in where.iterdir() if f.name.endswith(_ENDINGS)]
        size = sum(stat.st_size for stat, _ in files)
        if size <= largest:
            return
        for stat, file in sorted(files, key=lambda pair: max(pair[0].st_atime, pair[0].st_mtime)):
            file.unlink(missing_ok=True)
            size -= stat.st_size
            if size <= largest // 2:
                return
    except OSError:
        return  # another command is at it, or the folder is not ours to clear


# -- the command -------------------------------------------------------------------------------------------------------


GOOD, FAILED, BAD_INPUT = 0, 1, 2
"""Exit codes: everything was found; the analysis failed; the question was wrong."""

COMMANDS = {
    "demo": ("read_demo", "run"),
    "check": ("read_model", "commands"),
    "run": ("read_run", "run"),
    "parts": ("read_model", "run"),
    "simulate": ("read_model", "run"),
    "synthesise": ("read_problem", "commands"),
    "trace": ("read_curve", "commands"),
    "modes": ("read_modes", "run"),
    "compare": ("read_model", "commands"),
    "export": ("read_model", "commands"),
    "report": ("read_report", "commands"),
}
"""By command: the function that reads its question, and the module whose function ``do_…`` carries it out."""


_EPILOG = """\
examples:
  jaxnc demo slider-crank              a ready mechanism: report, pictures and tables in jaxnc-demo/
  jaxnc check four_bar.toml            does it assemble, what may be driven, what looks wrong
  jaxnc run four_bar.toml --out out    analyse it as its [run] table says, files into out/
  jaxnc run four_bar.toml --input phi=0:180:91 --rate phi=360
  jaxnc simulate pendulum.toml --duration 5 --out swing
  jaxnc synthesise path.toml --out designs
  jaxnc trace curve.svg --seconds 60 --out linkages
  jaxnc modes four_bar.toml --map phi=0:360    every assembly, and which can be reached from which
  jaxnc parts four_bar.toml --width 16 --pin 5 --thickness 3 --out plates
  jaxnc compare four_bar.toml          the same in every family of coordinates: counts, equations, cost
  jaxnc export four_bar.toml --to mjcf     a file for MuJoCo, or --to urdf
  jaxnc report four_bar.toml           all that is known of it, on one page
  jaxnc run four_bar.toml --expect 'psi range > 30' --json    a verdict for machines (docs/report.md)

compiled programs are kept, so that a command starts faster the second time: in ~/.cache/jaxnc (Linux),
~/Library/Caches/jaxnc (macOS), %LOCALAPPDATA%\\jaxnc (Windows), or where JAX_COMPILATION_CACHE_DIR says.
JAXNC_CACHE=FOLDER keeps them elsewhere; JAXNC_CACHE=off, or --no-cache after a command, does without.

exit codes: 0 good, 1 the mechanism could not be moved as asked, 2 bad input, 130 interrupted.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: words after the command's name; those of the process if not given.

    Returns:
        The exit code: 0 good, 1 analysis failed, 2 bad input, 130 interrupted (with one line on stderr that says what).
    """
    with command_process():
        return _run_to_exit_code(sys.argv[1:] if arguments is None else arguments)


def _run_to_exit_code(arguments: Sequence[str]) -> int:
    """Carry a command out. Every end has its exit code and, if it is no good one, its line."""
    verdict = Verdict()
    try:
        options = command_parser().parse_args(arguments)
        if options.json_schema:
            print(json.dumps(schema(), indent=1))
            return GOOD
        if options.command is None:
            command_parser().print_help()
            return BAD_INPUT
        options.verdict = verdict
        # Where a verdict is asked for, nothing else is printed.
        with contextlib.redirect_stdout(io.StringIO()) if options.json else contextlib.nullcontext():
            code = _answer_question(options)
        if options.json:
            print(options.verdict.close(code).to_json())
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # Whoever read the report (head, less) has gone. Python would complain again when it closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt as error:
        print("; ".join(["jaxnc: interrupted", *map(str, error.args)]), file=sys.stderr)
        return 130
    except (JaxncError, OSError) as error:
        said, failed = " ".join(str(error).split()), isinstance(error, AssemblyError)
        code = FAILED if failed else BAD_INPUT
        if "--json" in arguments:
            verdict.add("not-found" if failed else "bad-input", "error", said)
            verdict.does = False if failed else None
            with contextlib.suppress(OSError):  # else what is wrong is that nothing can be printed
                print(verdict.close(code).to_json(), flush=True)
                return code
        print(f"jaxnc: {said}", file=sys.stderr)
        return code


@contextlib.contextmanager
def command_process() -> Iterator[None]:
    """Prepare the process for a command: any text can be printed, a warning is one line, and no Ctrl-C is lost.

    Letters that the screen, or the file behind it, does not have become question marks. Without a standard output
    nothing is printed. Pictures are drawn for files, whatever matplotlib is told to show windows with.
    """
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (stands for the process's own)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")
    before, backend = sys.unraisablehook, os.environ.get("MPLBACKEND")

    def interrupt_again(problem: Any) -> None:
        """Repeat a Ctrl-C that Python's collector, which calls JAX, would print and forget."""
        if issubclass(problem.exc_type, KeyboardInterrupt):
            # An interruption can be lost: it is asked for again after a moment.
            threading.Timer(0.01, _thread.interrupt_main).start()
        else:
            before(problem)

    os.environ["MPLBACKEND"], sys.unraisablehook = "agg", interrupt_again
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: print(f"jaxnc: warning: {message}", file=sys.stderr)
            yield
    finally:
        sys.unraisablehook = before
        os.environ.pop("MPLBACKEND")
        if backend is not None:
            os.environ["MPLBACKEND"] = backend


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are errors like all others."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        found, rest = super().parse_known_args(args, namespace)
        for word in rest:
            if word.startswith("--"):
                known = re.findall(r"--[a-z-]+", self.format_usage())
                self.error(f"there is no option {word!r}; {nearest(word.partition('=')[0], known)}")
        return found, rest

    def error(self, message: str) -> NoReturn:
        if found := re.search(r"argument (\S+): invalid choice: '?(.+?)'? \(choose from (.*)\)", message):
            noun = "command" if found[1] == "COMMAND" else f"choice of {found[1]}"
            known = re.findall(r"[\w-]+", found[3])
            message = f"there is no {noun} {found[2]!r}; {nearest(found[2], known)}"
        raise InputError(f"{message} (see `{self.prog} --help`)")


def _answer_question(options: argparse.Namespace) -> int:
    """Read the question and print what it is about before JAX is imported, which takes a while; then answer it."""
    begin, name = time.perf_counter(), options.command
    options.verdict.command = name
    from jaxnc.cli import question as reading
    from jaxnc.io.files import blame
    from jaxnc.progress import step_bar

    for text in getattr(options, "expect", ()):
        parse_expectation(text)
    read, module = COMMANDS[name]
    question = getattr(reading, read)(options)
    if question is None:
        return GOOD
    options.verdict.name, units = question.mechanism.name, question.mechanism.model.units
    if name != "trace":  # whose curves have no unit
        options.verdict.length_unit, options.verdict.angle_unit = units.length, units.angle
    if question.title:
        print(question.title, flush=True)
    with step_bar(1) as step:
        step("importing JAX")
        configure(options.no_cache)
        do = getattr(importlib.import_module(f"jaxnc.cli.{module}"), f"do_{name}")
    try:
        return do(question, options, time.perf_counter() - begin)
    except MechanismError as error:
        if question.file is None:
            raise
        raise blame(question.file, error) from None


def configure(no_cache: bool) -> None:
    """Switch 64-bit numbers on and keep compiled programs. A folder that cannot be written costs a line only."""
    import jax

    from jaxnc.process import CACHE

    if told := os.environ.get("JAX_PLATFORMS"):
        try:
            jax.devices()
        except (RuntimeError, AssertionError):
            raise InputError(
                f"JAX_PLATFORMS={told}: JAX has no such device here; unset the variable, or set it to cpu"
            ) from None
    jax.config.update("jax_enable_x64", True)
    try:
        if not no_cache and cache() is not None:
            return
    except OutputError as error:
        print(
            f"jaxnc: warning: compiled programs are not kept: {error}; {CACHE}=FOLDER names one, --no-cache does "
            f"without",
            file=sys.stderr,
        )
    jax.config.update("jax_enable_compilation_cache", False)


_KEYS = -(2**63), 2**63 - 1


def _whole(low: int, high: int) -> Callable[[str], int]:
    """Return the reader of an option that is a whole number from low to high."""

    def parse(text: str) -> int:
        if not re.fullmatch(r"[+-]?\d+", text) or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text}: expected a whole number from {low} to {high}")
        return int(text)

    return parse


def command_parser() -> argparse.ArgumentParser:
    """The parser of all commands and their options."""
    parser = _Parser(
        prog="jaxnc",
        allow_abbrev=False,  # --json in front of a command would be --json-schema
        description="Mechanisms in natural coordinates: positions, velocities, accelerations, pictures.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"jaxnc {jaxnc.__version__}")
    parser.add_argument("--json-schema", action="store_true", help="print the JSON Schema of what --json prints")
    parser.set_defaults(command=None, json=False)
    commands = parser.add_subparsers(metavar="COMMAND", parser_class=_Parser)

    demo = commands.add_parser("demo", help="analyse a ready mechanism and write pictures of it")
    demo.add_argument("name", nargs="?", default="slider-crank", metavar="NAME", help="which one (slider-crank)")
    demo.add_argument("--list", action="store_true", help="list the ready mechanisms")
    _add_output(demo, "jaxnc-demo")

    check = commands.add_parser("check", help="say whether a model assembles and what may be driven")

    run = commands.add_parser("run", help="analyse a model as its [run] table says")
    _add_run(run)
    _add_output(run, None)
    parts = commands.add_parser(
        "parts", help="drawings of a planar mechanism's parts, as plates in layers, for a workshop"
    )
    parts.add_argument("file", metavar="FILE", help="a model file, .toml or .json, with a [run] table")
    for name, what in (("width", "of links"), ("pin", "diameter of pins"), ("thickness", "of plates")):
        parts.add_argument(f"--{name}", type=float, required=True, metavar="MM", help=f"{what}, mm")
    parts.add_argument("--clearance", type=float, metavar="MM", help="between parts that pass each other (1)")
    parts.add_argument("--play", type=float, metavar="MM", help="what holes are wider than pins (0.1)")
    parts.add_argument("--washer", type=float, metavar="MM", help="thickness of washers between layers (0.5)")
    parts.add_argument("--spacer", type=float, metavar="MM", help="outer diameter of washers (twice the pin's)")
    parts.add_argument("--unit", type=float, metavar="MM", help="how long the model's unit of length is")
    parts.add_argument("--layers", type=int, metavar="N", help="how many there may be above the ground plate")
    parts.add_argument("--density", type=float, metavar="KG/M3", help="of the plates, for their masses: 7850 for steel")
    parts.add_argument("--format", choices=("dxf", "svg"), help="write only these (both)")
    parts.add_argument("--out", metavar="DIR", help="write drawings and the table of parts into DIR")
    simulate = commands.add_parser("simulate", help="move a model under its forces, as its [simulate] table says")
    simulate.add_argument("file", metavar="FILE", help="a model file, .toml or .json, with masses")
    simulate.add_argument("--duration", type=float, metavar="S", help="seconds, from the start of the motion")
    simulate.add_argument("--times", type=int, metavar="N", help="how many times are kept")
    simulate.add_argument("--method", metavar="NAME", help="dopri8 (default), kvaerno5 (stiff), rk4, …")
    simulate.add_argument("--step", type=float, metavar="S", help="longest step of a method of fixed step")
    simulate.add_argument("--rtol", type=float, metavar="R", help="relative tolerance of an adaptive step")
    _add_repeatable(simulate, "--rate", "NAME=RATE", "a rate at the start (phi=90deg); may be repeated")
    simulate.add_argument("--resume", metavar="NPZ", help="go on from the last state in a table of an earlier run")
    simulate.add_argument("--out", metavar="DIR", help="write tables, pictures and a page into DIR")
    simulate.add_argument("--no-pictures", action="store_true", help="write tables only")
    simulate.add_argument("--no-html", action="store_true", help="leave the page out")
    simulate.add_argument("--animate", action="store_true", help="also write an animated GIF, in real time")
    synthesise = commands.add_parser("synthesise", help="search for designs that do what a problem file says")
    synthesise.add_argument("file", metavar="FILE", help="a problem file, .toml or .json")
    synthesise.add_argument("--starts", type=int, metavar="N", help="random designs to look at")
    synthesise.add_argument("--refine", type=int, metavar="N", help="how many of them are refined")
    synthesise.add_argument("--seconds", type=float, metavar="S", help="stop after so long")
    synthesise.add_argument("--key", type=_whole(*_KEYS), metavar="N", help="another number gives other random designs")
    synthesise.add_argument("--checkpoint", metavar="FILE", help="keep the search in FILE while it runs")
    synthesise.add_argument("--resume", metavar="FILE", help="go on with the search that was kept in FILE, and keep it")
    synthesise.add_argument("--out", metavar="DIR", help="write the designs as model files, and pictures, into DIR")
    synthesise.add_argument("--no-pictures", action="store_true", help="write tables and models only")
    trace = commands.add_parser("trace", help="find four-, six- and eight-bars that trace a curve")
    trace.add_argument(
        "file", metavar="FILE", nargs="?", help="the curve: an SVG path, or x and y in a .csv, .txt or .npy file"
    )
    trace.add_argument(
        "--page", metavar="HTML", nargs="?", const="", help="draw the curve on a page; with a name, one without Python"
    )
    trace.add_argument("--port", type=_whole(0, 65535), default=0, metavar="N", help="of the page (any that is free)")
    trace.add_argument("--bars", metavar="N[,N]", help="numbers of links: 4, 6, 8 (all)")
    trace.add_argument("--seconds", type=float, default=60.0, metavar="S", help="time for the search (60)")
    trace.add_argument(
        "--key", type=_whole(*_KEYS), default=0, metavar="N", help="another number gives other random designs"
    )
    ends = trace.add_mutually_exclusive_group()
    ends.add_argument("--closed", action="store_true", default=None, help="the last point is joined to the first")
    ends.add_argument("--open", action="store_false", dest="closed", help="it is not; without either, where they meet")
    trace.add_argument("--no-sliders", action="store_true", help="turning joints only")
    trace.add_argument("--checkpoint", metavar="FILE", help="keep the search in FILE while it runs")
    trace.add_argument("--resume", metavar="FILE", help="go on with the search that was kept in FILE, and keep it")
    trace.add_argument("--transmission", type=float, metavar="DEG", help="smallest transmission angle, degrees (8)")
    trace.add_argument("--out", metavar="DIR", help="write the linkages as model files, and a picture, into DIR")
    trace.add_argument("--no-pictures", action="store_true", help="write models only")
    modes = commands.add_parser("modes", help="list every assembly of a model, or over the range of an input")
    modes.add_argument("file", metavar="FILE", help="a model file, .toml or .json")
    said = "where an input stands (phi=60, phi=1.2rad), instead of where the file begins; may be repeated"
    _add_repeatable(modes, "--input", "NAME=VALUE", said)
    said = "go over a range of this input, and join the assemblies up into branches and circuits (181 values)"
    _add_repeatable(modes, "--map", "NAME=FROM:TO[:VALUES]", said)
    _add_repeatable(modes, "--hold", "NAME[,NAME]", "coordinates that stay put")
    _add_repeatable(modes, "--output", "NAME[,NAME]", "points and coordinates to list instead of those of the file")
    modes.add_argument("--seed", type=int, default=0, metavar="N", help="another number takes other ways (0)")
    modes.add_argument("--most", type=int, default=1000, metavar="N", help="solutions to look for at most (1000)")
    modes.add_argument("--prove", action="store_true", help="prove by the trace test that no solution is missing")
    modes.add_argument("--out", metavar="DIR", help="write a table and a picture into DIR")
    modes.add_argument("--no-pictures", action="store_true", help="write the table only")
    compare = commands.add_parser("compare", help="look at a model in every family of coordinates, side by side")
    compare.add_argument(
        "--families", metavar="NAME[,NAME]", help="which: independent, relative, reference, natural, mixed (all)"
    )
    compare.add_argument("--out", metavar="DIR", help="write tables, a plot and the equations into DIR")
    compare.add_argument("--no-pictures", action="store_true", help="write tables and equations only")
    export = commands.add_parser("export", help="write a model for a simulator of robots")
    export.add_argument("--to", choices=("mjcf", "urdf"), required=True, help="MuJoCo's format, or URDF with its loops")
    export.add_argument("--out", metavar="DIR", help="write NAME.xml, or NAME.urdf, into DIR (this folder)")
    report = commands.add_parser("report", help="write all that is known of a mechanism on one page")
    report.add_argument("file", metavar="FILE", help="a model file, .toml or .json, or the name of a ready mechanism")
    _add_run(report)
    report.add_argument("--out", metavar="FILE", help="the page, or a folder for it (NAME-report.html in this one)")
    report.add_argument("--poses", type=int, metavar="N", help="number of poses instead of the default")
    for command in (check, run, compare, export):
        command.add_argument("file", metavar="FILE", help="a model file, .toml or .json")
    for command in (demo, run, report):
        said = "something to hold, such as 'psi range > 30', 'P.y largest <= 0.2', 'transmission > 40'"
        _add_repeatable(command, "--expect", "TEXT", said)
    for name, command in commands.choices.items():
        command.set_defaults(command=name)
        command.add_argument("--json", action="store_true", help="print a verdict for machines, and nothing else")
        command.add_argument("--no-cache", action="store_true", help="keep no compiled programs, and use none")
    return parser


def _add_repeatable(parser: argparse.ArgumentParser, name: str, metavar: str, said: str) -> None:
    """Add an option that may be repeated."""
    parser.add_argument(name, action="append", default=[], metavar=metavar, help=said)


def _add_run(parser: argparse.ArgumentParser) -> None:
    said = "drive this coordinate instead of those of the file; angles in the file's unit, or 0deg:360deg"
    _add_repeatable(parser, "--input", "NAME=FROM:TO[:POSES]", said)
    _add_repeatable(
        parser, "--rate", "NAME=RATE", "constant rate of an input, per second; gives velocities and accelerations"
    )
    said = "points, markers and coordinates to report instead of those of the file"
    _add_repeatable(parser, "--output", "NAME[,NAME]", said)
    _add_repeatable(parser, "--hold", "NAME[,NAME]", "coordinates that stay put")
    parser.add_argument(
        "--analysis",
        choices=("sweep", "solve_position", "circuit"),
        help="in order along the branch (default), every pose on its own, or through dead points",
    )


def _add_output(parser: argparse.ArgumentParser, out: str | None) -> None:
    where = f"into DIR ({out})" if out else "into DIR; without it only the report is printed"
    parser.add_argument("--out", metavar="DIR", default=out, help=f"write tables, pictures and a page {where}")
    parser.add_argument("--poses", type=int, metavar="N", help="number of poses instead of the default")
    parser.add_argument("--no-pictures", action="store_true", help="write tables only")
    parser.add_argument("--no-html", action="store_true", help="leave the page out")
    parser.add_argument("--animate", action="store_true", help="also write an animated GIF")
