"""The tables of the site, made from the code. What the code has and no table says anything of is an error.

Nothing here needs Sphinx: `tests/docs/test_site.py` makes the tables too.
"""

import argparse
import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import said

import jaxnc as nc
from jaxnc import errors
from jaxnc.cli.main import command_parser
from jaxnc.constraints import CATALOGUE as KINDS
from jaxnc.constraints import RATES
from jaxnc.dynamics.simulate import FIXED
from jaxnc.forces import CATALOGUE as FORCES
from jaxnc.io import source
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.model import angle_forms, distance_forms
from jaxnc.viz.poses import poses as seen
from jaxnc.viz.quantities import _RATES, _TURNS, ENERGIES, EXERTED, quantity

ROOT = Path(__file__).parent.parent.parent


class NothingSaid(LookupError):
    """The code has something that the site says nothing of, or the other way round."""


# -- writing ----------------------------------------------------------------------------------------------------------


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table in Markdown."""

    def line(cells: Sequence[Any]) -> str:
        return "| " + " | ".join(" ".join(str(c).split()).replace("|", "\\|") for c in cells) + " |"

    return "\n".join([line(head), "|" + "---|" * len(head), *map(line, rows)]) + "\n"


def page(title: str, about: str, *parts: str) -> str:
    """A page, whose first words say where it is from."""
    return "\n".join([f"# {title}", "", textwrap.dedent(about).strip(), "", *parts])


def code(*words: Any) -> str:
    return ", ".join(f"`{w}`" for w in words)


def told(what: str, texts: Mapping[str, str], names: Iterable[str]) -> dict[str, str]:
    """Texts by name, one for each name and no other.

    Raises:
        NothingSaid: a name without a text, or a text without a name.
    """
    names = list(names)
    missing, idle = [n for n in names if n not in texts], [n for n in texts if n not in names]
    if missing or idle:
        raise NothingSaid(
            f"{what}: docs/_ext/said.py says nothing of {missing}" * bool(missing)
            + " and " * bool(missing and idle)
            + f"{what}: docs/_ext/said.py speaks of {idle}, which the code does not have" * bool(idle)
        )
    return {n: texts[n] for n in names}


def arguments(function: Callable[..., Any]) -> dict[str, str]:
    """What a docstring says of each argument."""
    found = re.search(r"\n *Args:\n(.*?)(\n\n|\Z)", inspect.getdoc(function) or "", re.S)
    text = textwrap.dedent(found[1]) if found else ""
    each = re.findall(r"^([\w*, ]+):(.*(?:\n .*)*)", text, re.M)
    return {name.strip(" *"): " ".join(what.split()) for names, what in each for name in names.split(",")}


def first(thing: Any) -> str:
    """The first sentence of a docstring."""
    text = inspect.getdoc(thing)
    if not text:
        raise NothingSaid(f"{thing!r} has no docstring")
    return " ".join(text.split("\n\n")[0].split())


# -- what a mechanism is made of --------------------------------------------------------------------------------------


def _body(dim: int, points: int, vectors: int, line: bool, plane: bool, form: str) -> tuple[int, int, list[str]]:
    """Coordinates, rows and kinds of a body by itself."""
    m = nc.Mechanism("body", dim=dim)
    places = [(0, 0, 0), (1, 0, 0), (0.3, 0.8, 0), (0.9, 0.7, 0.6), (0.2, 0.5, 0.9)]
    flat = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
    ways = [(1, 0, 0)] if line and vectors == 1 else [(0.3, 1, 0), (0.2, 0.4, 0 if plane else 1), (0.5, -1, 0.4)]
    names = [m.point(f"P{k}", (flat if line else places)[k][:dim]) for k in range(points)]
    aims = [m.vector(f"u{k}", ways[k]) for k in range(vectors)]
    m.body("body", names, **({"vectors": aims} if aims else {}), form=form)
    top = m.compile().topology
    rows = sum(len(b.kind.rows) * b.count for b in top.blocks)
    plain = [re.sub(r"( of)? [pv]+$", "", b.kind.name) for b in top.blocks if b.kind.rows]
    return dim * (points + vectors), rows, list(dict.fromkeys(plain))


def bodies() -> str:
    """Bodies of both dimensions, counted by compiling each."""
    parts = []
    for dim, title in ((2, "In the plane"), (3, "In space")):
        rows = []
        for name, what in told("bodies", said.BODIES[dim], said.BODIES[dim]).items():
            n, count, kinds = _body(dim, *what, form="exact")
            _, _, text = _body(dim, *what, form="text")
            rows.append((name, n, count, ", ".join(kinds), ", ".join(text) if text != kinds else "the same"))
        head = ("body", "coordinates", "rows", "kinds of its rows", 'with `form="text"`')
        parts += [f"## {title}\n", table(head, rows)]
    arguments_of = table(("argument", "what it is"), [(code(k), v) for k, v in arguments(Mechanism.body).items()])
    return page(
        "Bodies",
        """
        What [`m.body`](../modelling.md#bodies) writes, counted by compiling each body by itself. A row is one equation;
        its kind is in the [table of kinds](constraints.md).
        """,
        *parts,
        "## Arguments of `m.body`\n",
        arguments_of,
    )


def _fields(
    spec: type, where: Callable[..., Any] | None, own: Mapping[str, str] = {}
) -> list[tuple[str, str, str, str]]:
    """Keys of a record: name, type in words, default, meaning."""
    info: Any = source.inspect_record(spec)
    texts = (arguments(where) if where else {}) | own
    out = []
    for field in info.fields:
        name = field.encode_name
        what = texts.get(name) or texts.get(said.KEYS_AS.get(f"{spec.__name__}.{name}", ""))
        what = what or said.KEYS.get(f"{spec.__name__}.{name}")
        if not what:
            raise NothingSaid(f"key {name!r} of {spec.__name__}: docs/_ext/said.py says nothing of it (KEYS)")
        default = "needed" if field.required else _default(field)
        out.append((code(name), source.describe(field.type), default, what))
    return out


def _default(field: Any) -> str:
    if field.default is msgspec.NODEFAULT:
        made = field.default_factory()
        return "none" if isinstance(made, msgspec.Struct) or not made else code(made)
    return (
        "none"
        if field.default in (None, "", (), [], {})
        else code(str(field.default).lower() if isinstance(field.default, bool) else field.default)
    )


HEAD = ("key", "what it is", "default", "meaning")


def tags() -> dict[str, type]:
    """Records of joints by the tag that model files have."""
    return {spec.__struct_config__.tag: spec for spec in record.Joint.__args__}


def method(tag: str) -> Callable[..., Any]:
    """The builder's method for a joint.

    Raises:
        NothingSaid: there is none.
    """
    found = getattr(Mechanism, tag.replace(" ", "_"), None)
    if found is None:
        raise NothingSaid(f"joint {tag!r}: Mechanism has no method {tag.replace(' ', '_')!r}")
    return found


def joints() -> str:
    """Joints, with the method and the keys of each."""
    where = told("joints", said.JOINTS, tags())
    rows = [(f"[{tag}](#{tag.replace(' ', '-')})", where[tag], first(spec)) for tag, spec in tags().items()]
    parts = [table(("joint", "in", "what it does"), rows)]
    for tag, spec in tags().items():
        name = method(tag).__name__
        parts += [f"## {tag}\n", f"{first(method(tag))} In Python [`m.{name}`](#jaxnc.Mechanism.{name}), in files:\n"]
        parts += [
            table(
                HEAD,
                [
                    (code("joint"), f"`{tag!r}`".replace("'", '"'), "needed", "which joint it is"),
                    *_fields(spec, method(tag)),
                ],
            )
        ]
    relation = _fields(record.Relation, Mechanism.relation)
    parts += [
        "## relation\n",
        f"{first(Mechanism.relation)} A table of its own, `[relations]`:\n",
        table(HEAD, relation),
    ]
    parts += ["## constraint\n", f"{first(Mechanism.constrain)} A table of its own, `[constraints]`:\n"]
    parts += [table(HEAD, _fields(record.Constraint, Mechanism.constrain))]
    return page(
        "Joints",
        """
        A shared point is a hinge in the plane and a ball in space, a shared point and vector a hinge in space: they
        need no joint. How many rows each joint writes, and which equations they are, is in the guides
        ([plane](../modelling.md#joints), [space](../spatial.md#joints)).
        """,
        *parts,
    )


def coordinates() -> str:
    """Coordinates, and the forms in which angles and distances are written."""
    kinds = told("coordinates", said.COORDINATES, said.COORDINATES)
    parts = [table(("coordinate", "how it is made"), [(code(n), t) for n, t in kinds.items()])]
    forms = told("forms", said.FORMS, dict.fromkeys(f for d in (2, 3) for f in (*angle_forms(d), *distance_forms(d))))

    def mark(form: str, of: Callable[[int], list[str]]) -> str:
        found = [word for d, word in ((2, "plane"), (3, "space")) if form in of(d)]
        return ", ".join(found) or "–"

    rows = [(code(f), mark(f, angle_forms), mark(f, distance_forms), t) for f, t in forms.items()]
    parts += ["## Forms\n", table(("`form=`", "angles in", "distances in", "what is written"), rows)]
    for name, spec, builder in (
        ("angle", record.Angle, Mechanism.angle),
        ("distance", record.Distance, Mechanism.distance),
    ):
        parts += [f"## {name.capitalize()}s\n", f"[`m.{name}`](#jaxnc.Mechanism.{name}), in files `[{name}s]`:\n"]
        parts += [table(HEAD, _fields(spec, builder))]
    return page("Coordinates", "What is solved for, driven, plotted and written into tables, by name.", *parts)


def constraints() -> str:
    """Kinds of constraints, those that differ only in what stands for a direction in one line."""
    groups: dict[str, list[Any]] = {}
    for kind in KINDS.values():
        groups.setdefault(re.sub(r"(?<= )[pv]+(?=$|,)", "…", kind.name), []).append(kind)
    rows = []
    for name, kinds in groups.items():
        one = kinds[0]
        takes = {
            f"{k.points} points" * bool(k.points)
            + ", " * bool(k.points and k.vectors)
            + f"{k.vectors} vectors" * bool(k.vectors)
            for k in kinds
        }
        scalars = f"; {one.scalars} coordinates" * bool(one.scalars)
        several = "points, vectors or both" if len(takes) > 1 else next(iter(takes))
        checks = "yes, mirror" if one.mirror else "yes" if one.guard else ""
        rows.append(
            (name, ", ".join(one.rows) or "none", several + scalars, ", ".join(one.constants), checks, one.source)
        )
    head = ("kind", "rows", "takes", "constants", "guard", "source")
    rates = [
        (k.name, ", ".join(k.rows), f"{k.points} points, {k.vectors} vectors", ", ".join(k.constants), k.source)
        for k in RATES.values()
    ]
    return page(
        "Kinds of constraints",
        """
        Every row of a system belongs to one of these kinds. "…" stands for which of its directions are vectors (v) and
        which are pairs of points (p). A *guard* excludes a solution that the rows admit, such as φ + π. Numbers in
        brackets are equations of the [source text](../sources.md). A kind of your own takes the same path:
        [how](../project/contributing.md#add-a-constraint-kind-in-one-place).
        """,
        table(head, rows),
        "## On velocities\n",
        table(("kind", "rows", "takes", "constants", "source"), rates),
    )


def forces() -> str:
    """Kinds of forces, and the methods that apply them."""
    texts = told("forces", said.FORCES, FORCES)
    rows = []
    for name, kind in FORCES.items():
        takes = f"{kind.points} points" if kind.points else f"{kind.scalars} coordinate"
        how = ", ".join(word for word in ("potential", "dissipation", "force") if getattr(kind, word))
        rows.append((name, takes, code(*kind.parameters), how, texts[name]))
    calls = told("loads", said.LOADS, said.LOADS)
    parts = [table(("kind", "takes", "parameters", "given by", "law"), rows), "## How they are applied\n"]
    parts += [
        table(
            ("call", "what it does"),
            [(f"[`m.{n}`](#jaxnc.Mechanism.{n})", first(getattr(Mechanism, n))) for n in calls],
        )
    ]
    for n in calls:
        known = arguments(getattr(Mechanism, n))
        if known:
            parts += [f"### `m.{n}`\n", table(("argument", "what it is"), [(code(k), v) for k, v in known.items()])]
    return page(
        "Forces",
        """
        Parameters are design variables, `"<force>.<parameter>"`. What each kind is given by is differentiated: nothing
        is derived by hand. `c` are the parameters, `x` the length or the coordinate, less its free value for springs.
        """,
        *parts,
    )


# -- what is asked ----------------------------------------------------------------------------------------------------


def options() -> str:
    """Options of the analyses, from their docstrings."""
    found: dict[tuple[str, str], list[str]] = {}
    defaults: dict[tuple[str, str], set[str]] = {}
    for name, function in said.ANALYSES.items():
        texts = arguments(function)
        for p in inspect.signature(function).parameters.values():
            if p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL):
                continue
            if p.name not in texts:
                raise NothingSaid(f"{name}: its docstring says nothing of {p.name!r}")
            key = (p.name, texts[p.name])
            found.setdefault(key, []).append(name)
            shown = "needed" if p.default is p.empty else code(repr(p.default).split(" at 0x")[0].strip("<>"))
            defaults.setdefault(key, set()).add(shown)
    rows = []
    for (name, text), of in sorted(found.items(), key=lambda item: item[0][0]):
        rows.append(
            (
                code(name),
                ", ".join(f"[`{n}`](#{said.where(n)})" for n in of),
                ", ".join(sorted(defaults[name, text])),
                text,
            )
        )
    methods = told("methods of simulate", said.METHODS, (*said.ADAPTIVE, *FIXED))
    steps = [(code(f'"{n}"'), "fixed" if n in FIXED else "adaptive", t) for n, t in methods.items()]
    return page(
        "Options",
        "What the analyses take, from their docstrings. Where two take the same option in two ways it has two lines.",
        table(("option", "of", "default", "meaning"), rows),
        "## Methods of `simulate`\n",
        table(("`method=`", "step", "what"), steps),
    )


def commands() -> str:
    """The command line, from its own parser."""
    parser = command_parser()
    choices = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    helps = {a.dest: a.help for a in choices._choices_actions}
    parts = [table(("command", "what it does"), [(f"[`jaxnc {n}`](#jaxnc-{n})", helps[n]) for n in choices.choices])]
    for name, sub in choices.choices.items():
        rows = []
        for action in sub._actions:
            if isinstance(action, argparse._HelpAction):
                continue
            if not action.help:
                raise NothingSaid(f"jaxnc {name}: {action.dest} has no help")
            word = ", ".join(action.option_strings) or action.metavar or action.dest
            value = (
                ""
                if action.nargs == 0 or not action.option_strings
                else f" {action.metavar or '|'.join(action.choices or ['VALUE'])}"
            )
            rows.append((code(word + value), action.help % vars(action) if "%(" in action.help else action.help))
        parts += [f"## jaxnc {name}\n", f"{helps[name].capitalize()}.\n", table(("option", "meaning"), rows)]
    codes = told("exit codes", said.EXITS, ("0", "1", "2", "130"))
    parts += ["## Exit codes\n", table(("code", "meaning"), codes.items())]
    return page("Command line", "What `jaxnc --help` says, command by command.", *parts)


def statuses() -> str:
    """Statuses of poses."""
    what = told("statuses", said.STATUSES, [s.name for s in nc.Status])
    rows = [(code(s.name), int(s), s.sentence, what[s.name]) for s in sorted(nc.Status)]
    return page(
        "Statuses",
        """
        `motion.status` has one number for each pose; zero is good, everything else a failure, and `nc.Status(number)`
        names it. Where it is raised instead is told in the
        [guide](../modelling.md#what-is-raised-and-what-is-data).
        """,
        table(("status", "number", "sentence", "what to do"), rows),
    )


def mistakes() -> str:
    """Errors, and what to do."""
    kinds = [e for e in vars(errors).values() if inspect.isclass(e) and issubclass(e, errors.JaxncError)]
    advice = told("errors", said.ERRORS, [e.__name__ for e in kinds])
    rows = []
    for e in kinds:
        above = ", ".join(b.__name__ for b in e.__mro__[1:-3] if b is not Exception and b is not errors.JaxncError)
        rows.append((code(e.__name__), first(e), above, advice[e.__name__]))
    often = [(f"“{text}”", do) for text, do in said.MESSAGES.items()]
    source = "\n".join(p.read_text(encoding="utf-8") for p in (ROOT / "jaxnc").rglob("*.py"))
    joined = re.sub(r'"\s*\n\s*f?"', "", source)
    for text in said.MESSAGES:
        for part in text.split(" … "):
            if part.strip("… ") not in joined:
                raise NothingSaid(
                    f"errors: no message of the library says {part!r}; change MESSAGES in docs/_ext/said.py"
                )
    return page(
        "Errors and what to do",
        """
        Every error that the library raises on purpose is an `nc.JaxncError` whose text names what is at fault, what was
        expected, and what to try. On the command line it is one line on stderr.
        """,
        table(("error", "what", "is also", "what to do"), rows),
        "## Messages that are met often\n",
        table(("message", "what to do"), often),
    )


def plots() -> str:
    """Quantities that `plot` knows: each is looked up in a motion, which gives its unit."""
    m = nc.Mechanism("pendulum")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0, 1))
    m.body("bar", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.spring("return", "B", "D", stiffness=60.0)
    motion = nc.motion(m.compile(), {"phi": lambda t: 2 * t}, np.linspace(0, 0.4, 3), jerk=True)
    poses = seen(motion)
    nouns = {*_RATES, *_TURNS, *ENERGIES, *EXERTED, "time"}
    covered = {noun for name in said.PLOTS for noun in nouns if name == noun or name.startswith(noun + " ")}
    told("plots", dict.fromkeys(covered, ""), nouns)
    rows = []
    for name, text in said.PLOTS.items():
        if name.split()[0] in EXERTED:  # takes the reactions, which are compiled: the tests of plots do that
            rows.append((code(f'"{name}"'), text, *told("forces", said.EXERTED, EXERTED)[name.split()[0]]))
            continue
        found = quantity(poses, name)
        rows.append((code(f'"{name}"'), text, found.dimension, found.unit or "–", found.kind))
    return page(
        "What can be plotted",
        """
        `motion.plot(…)`, `motion.to_html(plots=…)` and `against=` take these names. The
        examples are of a pendulum: points A and B, body `bar`, its angle `phi`, a spring `return`.
        Rates need `rates=` (and `accelerations=`, `jerk=True`) of a sweep, or a motion in time;
        forces need masses. A vector is plotted by its components and its size, or by one component: `"velocity B.x"`.
        `plot` puts what has one unit on the same axes, unless one curve would take less than a tenth of
        their height beside the others and look flat. To choose: names in a list share axes, each list its own:
        `motion.plot(["B.x", "B.y"], ["phi"])`; so `motion.plot(["B.x"], ["B.y"])` are apart in any case.
        """,
        table(("name", "what it is", "axis", "unit", "kind"), rows),
    )


# -- files ------------------------------------------------------------------------------------------------------------


def model_files() -> str:
    """Keys of model files."""
    texts = told("model files", said.TABLES, record.Model.__struct_fields__)
    rows = []
    info: Any = source.inspect_record(record.Model)
    for field in info.fields:
        rows.append((code(field.encode_name), source.describe(field.type), texts[field.encode_name]))
    parts = [table(("at the top", "what it is", "meaning"), rows)]
    for title, (spec, where) in said.RECORDS.items():
        parts += [f"## {title}\n", first(spec) + "\n", table(HEAD, _fields(spec, where))]
    told("records of model files", dict.fromkeys([s.__name__ for s, _ in said.RECORDS.values()], ""), _records(record))
    return page(
        "Keys of model files",
        """
        A model file is TOML or JSON; the [guide](../modelling.md#model-files) has an example, and
        [examples](examples.md) has more. [Joints](joints.md) have a page of their own. A key that is not here is
        refused with its line and the nearest name.
        """,
        *parts,
    )


def _records(module: Any) -> list[str]:
    """Records of a module that files may hold, joints and what stands elsewhere excepted."""
    elsewhere = record.JointRecord, record.Model, record.Angle, record.Distance, record.Relation, record.Constraint
    kinds = [v for v in vars(module).values() if inspect.isclass(v) and issubclass(v, msgspec.Struct)]
    return [k.__name__ for k in kinds if not issubclass(k, elsewhere) and not k.__name__.startswith("_")]


def problem_files() -> str:
    """Keys of problem files."""
    parts = []
    told(
        "records of problem files",
        dict.fromkeys([s.__name__ for s, _ in said.PROBLEMS.values()], ""),
        _records(source),
    )
    for title, (spec, where) in said.PROBLEMS.items():
        parts += [f"## {title}\n", first(spec) + "\n", table(HEAD, _fields(spec, where))]
    return page(
        "Keys of problem files", "What `jaxnc synthesise` reads: [guide](../synthesis.md#problem-files).", *parts
    )


def library() -> str:
    """Ready mechanisms."""
    rows = []
    for name, make in nc.library.CATALOGUE.items():
        m = make().model
        call = f"[`nc.library.{make.__name__}`](#jaxnc.library.{make.__name__})"
        counts = f"{len(m.points)} points" + f", {len(m.vectors)} vectors" * bool(m.vectors)
        rows.append((code(name), call, "space" if m.dim == 3 else "plane", counts, len(m.bodies), first(make)))
    return page(
        "Ready mechanisms",
        "`jaxnc demo NAME` analyses and draws one of them; in Python it is a function of its dimensions.",
        table(("name", "function", "in", "moving", "bodies", "what it is"), rows),
    )


def examples() -> str:
    """Files to begin from, as they are."""
    parts = []
    for path in sorted((ROOT / "examples").rglob("*.toml")):
        name = path.relative_to(ROOT).as_posix()
        verb = "synthesise" if path.parent.name == "problems" else "run"
        head = f"## {path.name}\n\n`jaxnc {verb} {name}`\n"
        parts += [head, f"```toml\n{path.read_text(encoding='utf-8').strip()}\n```\n"]
    return page("Example files", "Model and problem files that are in the repository, to begin from.", *parts)


PAGES: dict[str, Callable[[], str]] = {
    "bodies": bodies,
    "joints": joints,
    "coordinates": coordinates,
    "constraints": constraints,
    "forces": forces,
    "options": options,
    "statuses": statuses,
    "errors": mistakes,
    "plots": plots,
    "model_files": model_files,
    "problem_files": problem_files,
    "commands": commands,
    "library": library,
    "examples": examples,
}


def pages() -> dict[str, str]:
    """All pages by their paths in the site's sources."""
    made = {f"tables/{name}.md": make() for name, make in PAGES.items()}
    tree = "\n".join(["```{toctree}", ":maxdepth: 1", "", *PAGES, "```", ""])
    about = "Made from the code by `python docs/_ext/tables.py`, and when the site is built."
    return made | {"tables/index.md": page("Tables", about, tree)}


if __name__ == "__main__":
    for name, text in pages().items():
        (ROOT / "docs" / name).parent.mkdir(exist_ok=True)
        (ROOT / "docs" / name).write_text(text, encoding="utf-8")
